"""Vertex block descent (Chen et al. 2024) for a cloth on one moving mesh, several times as fast as a general solver.

Newton's SolverVBD spends most of its time on what a cloth on a body never needs: derivatives of hinge angles by
vertices that do not move, one record a contact, truncation against self-contact. This is the same descent on the same
energies (a test holds it to SolverVBD's steps); Newton builds the model and its colouring. Where the cloth shall
collide with itself, vertices keep off triangles (`SelfContact`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from imgtransfer.simulation.cloth.self_contact import SelfContact
from imgtransfer.simulation.config import ClothConfig

# Contacts are searched once a step; the body may move this far (metres) within one without being missed.
CONTACT_GAP = 0.03
CONTACT_DAMPING = 1e-2  # N·s/m


class ClothDescent:
    """Steps a cloth in time.

    Args:
        model: a Newton model of one cloth; its masses, faces, hinges and colours are used.
        body: the Warp mesh that the cloth lies on, with velocities.
        material: see `ClothConfig`.
        iterations: of descent, a step.
        relaxation: factor on every move of a vertex; above 1 (successive over-relaxation) stretch, which spreads from
            vertex to vertex, converges in fewer iterations.
        self_contact: whether the cloth keeps its `thickness` from itself.
    """

    def __init__(
        self,
        model: Any,
        body: Any,
        material: ClothConfig,
        iterations: int,
        *,
        relaxation: float = 1.0,
        self_contact: bool = False,
    ) -> None:
        import warp  # noqa: PLC0415 (heavy)

        from imgtransfer.simulation.cloth import contact_kernels  # noqa: PLC0415 (heavy)
        from imgtransfer.simulation.cloth import descent_kernels as kernels  # noqa: PLC0415 (heavy)

        self._wp, self._kernels = warp, kernels
        self._device, self._body = model.device, body
        self._reach = CONTACT_GAP + material.thickness
        self._iterations = iterations
        self._gravity = warp.vec3(*model.gravity.numpy()[0].tolist())
        self._sheet = _sheet(model, warp, kernels)
        self._fabric = _fabric(material, relaxation, contact_kernels)
        self.self_contact = SelfContact(model, material.thickness) if self_contact else None
        self._touch = contact_kernels.Touch() if self.self_contact is None else self.self_contact.touch
        self._colours: list[Any] = [
            warp.array(group.numpy(), dtype=int, device=model.device) for group in model.particle_color_groups
        ]
        self._n = model.particle_count
        self._step = kernels.Step()
        for name in ("start", "goal", "surface", "normal", "speed"):
            setattr(self._step, name, warp.zeros(self._n, dtype=warp.vec3, device=model.device))
        self._step.metric = warp.zeros(len(self._sheet.faces), dtype=warp.vec3, device=model.device)
        self._step.angle = warp.zeros(len(self._sheet.hinges), dtype=float, device=model.device)
        self._recorded: dict[float, list[tuple[str, Any]]] = {}

    def step(self, state: Any, dt: float) -> None:
        """Move the particles of a Newton state in place by `dt` seconds; the body stands where it will be.

        Args:
            state: always the same one, as the kernels' arguments are prepared once.
            dt: the step, seconds.
        """
        if self.self_contact is not None:
            self.self_contact.update(state.particle_q)
        if dt not in self._recorded:
            self._recorded[dt] = self.commands(state, dt)
        for _, command in self._recorded[dt]:
            command.launch()

    def commands(self, state: Any, dt: float) -> list[tuple[str, Any]]:
        """The kernels of a step, by name and ready to launch: to prepare arguments costs more than many of them."""
        kernels, sheet, now = self._kernels, self._sheet, self._step
        position, velocity = state.particle_q, state.particle_qd

        def launch(kernel: Any, count: int, *arguments: Any) -> tuple[str, Any]:
            command = self._wp.launch(
                kernel, dim=count, inputs=arguments, device=self._device, record_cmd=True
            )
            return kernel.key, command

        around = self._touch, self._fabric
        descend = [
            launch(kernels.descend, len(members), sheet, now, *around, dt, members, position)
            for members in self._colours
        ]
        touches = []
        if self.self_contact is not None:
            touches = [
                launch(kernel, self._n, *given) for kernel, given in self.self_contact.commands(now.start)
            ]
        return [
            launch(kernels.begin, self._n, sheet, now, self._gravity, dt, velocity, position),
            launch(kernels.measure_faces, len(sheet.faces), sheet, now),
            launch(kernels.measure_hinges, len(sheet.hinges), sheet, now),
            launch(kernels.find_contacts, self._n, now, self._body.id, self._reach),
            *touches,
            *descend * self._iterations,
            launch(kernels.finish, self._n, now, 1 / dt, position, velocity),
        ]


def _fabric(material: ClothConfig, relaxation: float, kernels: Any) -> Any:
    """The material's and the descent's constants as `Fabric`."""
    fabric = kernels.Fabric()
    for name in (
        "stretch",
        "stretch_damping",
        "bending_damping",
        "contact_stiffness",
        "friction",
        "thickness",
    ):
        setattr(fabric, name, getattr(material, name))
    fabric.contact_damping = CONTACT_DAMPING
    fabric.relaxation = relaxation
    return fabric


def _sheet(model: Any, warp: Any, kernels: Any) -> Any:
    """The constants of the model's cloth as `Sheet`."""
    count, device = model.particle_count, model.device
    faces, poses = model.tri_indices.numpy(), model.tri_poses.numpy().reshape(-1, 4)
    edges = model.edge_indices.numpy()
    inner = (edges[:, :2] >= 0).all(axis=1)
    hinges = edges[inner]
    stiffness = model.edge_bending_properties.numpy()[inner, 0] * model.edge_rest_length.numpy()[inner]
    weights = np.stack([-(poses[:, :2] + poses[:, 2:]), poses[:, :2], poses[:, 2:]], axis=1)  # (F, 3, 2)
    around = [
        (faces[:, corner], np.stack([np.arange(len(faces)), faces[:, after], faces[:, last]], axis=1),
         np.concatenate([weights[:, after], weights[:, last]], axis=1)[:, [0, 2, 1, 3]])
        for corner, after, last in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    ]  # fmt: skip
    corner_start, corners, rest = _by_vertex(around, count)
    numbers = np.arange(len(hinges))
    turned = hinges[:, [1, 0, 3, 2]]  # the same hinge, seen from the other side
    tip_start, tips, tip_hinge = _by_vertex([(of[:, 0], of, numbers) for of in (hinges, turned)], count)
    spine_start, spines, spine_hinge = _by_vertex([(of[:, 2], of, numbers) for of in (hinges, turned)], count)
    sheet = kernels.Sheet()
    whole = {"corner_start": corner_start, "tip_start": tip_start, "spine_start": spine_start,
             "tip_hinge": tip_hinge, "spine_hinge": spine_hinge}  # fmt: skip
    for name, values in whole.items():
        setattr(sheet, name, warp.array(values.astype(np.int32), dtype=int, device=device))
    for name, values in {"faces": faces, "corners": corners}.items():
        setattr(sheet, name, warp.array(values.astype(np.int32), dtype=warp.vec3i, device=device))
    for name, values in {"hinges": hinges, "tips": tips, "spines": spines}.items():
        setattr(sheet, name, warp.array(values.astype(np.int32), dtype=warp.vec4i, device=device))
    for name, values in {"face_rest": poses[:, [0, 2, 1, 3]], "corner_rest": rest}.items():
        setattr(sheet, name, warp.array(values.astype(np.float32), dtype=warp.vec4, device=device))
    numeric = {
        "mass": model.particle_mass.numpy(),
        "area": model.tri_areas.numpy(),
        "hinge_stiffness": stiffness,
        "hinge_rest": model.edge_rest_angle.numpy()[inner],
    }
    for name, values in numeric.items():
        setattr(sheet, name, warp.array(values.astype(np.float32), dtype=float, device=device))
    return sheet


def _by_vertex(
    parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows sorted by their vertex: where each vertex's begin (count + 1,), and the two columns of rows."""
    vertex, first, second = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(vertex, kind="stable")
    starts = np.searchsorted(vertex[order], np.arange(count + 1))
    return starts, first[order], second[order]
