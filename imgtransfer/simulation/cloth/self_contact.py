"""A cloth and itself: where it touches, vertices against triangles, anew in every step."""

from __future__ import annotations

from typing import Any

import numpy as np

# Of a vertex on the penalty's spring, 1/s. Stiffer springs need more iterations than a step has to share a push between
# both layers; softer ones let fast cloth through (of 1,000, 2,000 and 4,500 the middle one left the fewest crossings).
FREQUENCY = 2000.0
TANGLE_STEPS = 8  # steps after which it is looked for anew where the cloth has passed through itself


class SelfContact:
    """Finds where a cloth touches itself, for `ClothDescent`.

    Vertices keep `apart` from the triangles of other parts of the cloth. Edges that cross edges are not seen, and in a
    narrow crease, such as a bent knee's, coarse cloth still passes through itself.

    Args:
        model: a Newton model of one cloth, in its rest shape.
        apart: metres that layers keep from each other.
    """

    def __init__(self, model: Any, apart: float) -> None:
        import warp  # noqa: PLC0415 (heavy)

        from imgtransfer.simulation.cloth import contact_kernels as kernels  # noqa: PLC0415 (heavy)

        self._wp, self._kernels, self._device = warp, kernels, model.device
        self._n = model.particle_count
        faces = model.tri_indices.numpy().astype(np.int32)
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        self._edges: Any = warp.array(np.unique(edges, axis=0), dtype=warp.vec2i, device=self._device)
        self._corners: Any = warp.array(faces.ravel(), dtype=int, device=self._device)
        self._mesh: Any = None
        self._steps = 0
        mass = model.particle_mass.numpy()
        stiffness = float(mass[mass > 0].mean() * FREQUENCY**2)
        self.touch = self._nowhere(model.particle_q.numpy(), faces, apart, stiffness)

    def update(self, position: Any) -> None:
        """Follow the vertices (N,) vec3, always the same array, to where a step starts."""
        if self._mesh is None:
            self._mesh = self._wp.Mesh(points=position, indices=self._corners)
        self._mesh.refit()
        if self._steps % TANGLE_STEPS == 0:
            self.touch.tangled.zero_()
            arguments = [self.touch, self._edges, self._mesh.id, position]
            self._wp.launch(
                self._kernels.find_tangles, dim=len(self._edges), inputs=arguments, device=self._device
            )
        self._steps += 1

    def commands(self, start: Any) -> list[tuple[Any, tuple[Any, ...]]]:
        """The kernels, each for N vertices, that find what touches what where a step starts, and their arguments."""
        return [
            (self._kernels.forget_touches, (self.touch,)),
            (self._kernels.find_touches, (self.touch, start, self._mesh.id)),
        ]

    def _nowhere(self, rest: np.ndarray, faces: np.ndarray, apart: float, stiffness: float) -> Any:
        """`Touch` of a cloth that does not touch itself."""
        warp, count = self._wp, self._n

        def zeros(kind: Any, shape: Any = count) -> Any:
            return warp.zeros(shape, dtype=kind, device=self._device)

        touch = self._kernels.Touch()
        touch.apart = apart
        touch.stiffness = stiffness
        touch.rest = warp.array(rest, dtype=warp.vec3, device=self._device)
        touch.faces = warp.array(faces, dtype=warp.vec3i, device=self._device)
        touch.face = warp.full(count, -1, dtype=int, device=self._device)
        touch.weights, touch.normal = zeros(warp.vec3), zeros(warp.vec3)
        touch.side, touch.tangled, touch.count = zeros(float), zeros(int), zeros(int)
        touch.others = zeros(int, (count, self._kernels.MOST_ON_CORNER))
        return touch
