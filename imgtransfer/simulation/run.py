"""Simulate one clip: settle, warm up, follow the motion, push out, check, store."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version

import numpy as np

from fusion import BodySdf
from imgtransfer.bodies.config import BodyConfig, make_body
from imgtransfer.bodies.skinned import BonePoses, SkinnedBody, skinned
from imgtransfer.data.clip import Clip
from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.config import GarmentConfig, TemplateConfig
from imgtransfer.garments.garment import Garment, make_garment
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.cloth import ClothOnBody
from imgtransfer.simulation.config import ClothConfig, SimulateConfig, SolverConfig
from imgtransfer.simulation.quality import Quality, faults, measure, push_out
from imgtransfer.simulation.substeps import skin_under, step_count
from render import InputError
from render.mesh import Mesh

SETTLE_DAMPING = 0.85  # of velocities, a frame, while the cloth comes to rest


class Rejected(InputError):
    """A clip that failed its gates twice; the message says which."""


def simulate_clip(motion: Motion, config: SimulateConfig) -> tuple[Clip, Quality]:
    """Simulate the garment on the body that follows `motion`.

    The clip's template is the garment as it hangs on the resting body, so that what a method must predict is the
    motion's doing and not the fall from the pattern. The cloth's own rest shape is the pattern.

    Every frame is cut into substeps by how far the body moves in it. A clip that fails a gate is simulated again with
    twice the substeps. Vertices left inside the body are pushed out to
    1 mm in front of it; positions are rounded to the 2⁻¹⁶ m grid, so that data sets store them compactly and exactly.

    Raises:
        Rejected: the second attempt failed, too.
    """
    worn = _worn(config.body, config.garment)
    body, pattern = worn.body, worn.garment.mesh
    template = round_to_grid(_settled(config.body, config.garment, config.cloth, config.solver, config.fps))
    bones = _placed(body, motion)
    solver = config.solver
    for attempt in (solver, solver.finer()):
        vertices, steps = _simulated(worn, template, bones, fps=motion.fps, config=config, solver=attempt)
        transforms = body.transforms(bones)
        moved = round_to_grid(body.vertices(transforms))
        vertices, quality = _checked(body, pattern, vertices, moved, motion.fps)
        wrong = faults(quality, config.gates)
        if not wrong:
            break
    else:
        raise Rejected(f"{motion.name}: rejected after two attempts: {'; '.join(wrong)}")
    # Weights and transforms give the body before rounding, that is within 8 µm.
    clip = Clip(
        template_vertices=template,
        garment_faces=pattern.faces.astype(np.int32),
        garment_vertices=vertices,
        body_rest=round_to_grid(body.rest),
        body_faces=body.faces,
        body_vertices=moved,
        fps=motion.fps,
        poses=motion.poses.astype(np.float32),
        trans=(bones.root - body.joints_rest[0]).astype(np.float32),
        joints_rest=body.joints_rest.astype(np.float32),
        parents=body.parents,
        blend_weights=body.blend_weights,
        joint_transforms=transforms.astype(np.float32),
        info={
            "source": f"imgtransfer simulate, motion {motion.name}",
            "licence": config.licence,
            "simulator": f"vertex block descent on Newton {version('newton')}, {steps.min()} to {steps.max()} substeps "
            f"(mean {steps.mean():.1f}), {attempt.iterations} iterations",
            "quality": quality.as_text(),
            "body": config.body.model_dump_json(exclude_unset=True),
            "garment": config.garment.model_dump_json(exclude_unset=True),
        },
        name=clip_name(config, motion),
    )
    return clip.with_surface(pattern.surface), quality


def clip_name(config: SimulateConfig, motion: Motion) -> str:
    """What a clip is called in its data set: garment/motion, and the body where it is not the default one."""
    garment = config.garment
    kind = garment.title if isinstance(garment, TemplateConfig) else garment.kind
    return f"{kind}/{'_'.join(part for part in (motion.name, config.body.title) if part)}"


@dataclass(frozen=True, eq=False)
class _Worn:
    """A garment on its body, the blend weights (H, K) with which its held vertices move, and the skin under it (M,)."""

    body: SkinnedBody
    garment: Garment
    weights: np.ndarray
    under: np.ndarray

    def cloth(self, config: ClothConfig, solver: SolverConfig) -> ClothOnBody:
        """The garment where it is put on, ready to be stepped."""
        body, mesh = self.body, self.garment.mesh
        return ClothOnBody(mesh, body.rest, body.faces, config, solver, held=self.garment.held)

    def stands(self, bones: BonePoses) -> tuple[np.ndarray, np.ndarray]:
        """(T, B, 3) skin and (T, H, 3) held vertices in the frames of `bones`."""
        transforms = self.body.transforms(bones).astype(np.float32)
        held = self.garment.mesh.vertices[self.garment.held]
        return self.body.vertices(transforms), skinned(transforms, self.weights, held)


@lru_cache(maxsize=4)
def _worn(wearer: BodyConfig, kind: GarmentConfig) -> _Worn:
    body = make_body(wearer)
    # Refitted from the default shape, so that a garment has the same faces on every shape of a body.
    like = None if wearer == wearer.reference else make_body(wearer.reference)
    garment = make_garment(body, kind, like=like)
    mesh = garment.mesh
    weights = body.weights_near(mesh.vertices[garment.held])
    return _Worn(body, garment, weights, skin_under(mesh.vertices, body.rest))


def _placed(body: SkinnedBody, motion: Motion) -> BonePoses:
    """The motion's bone poses, moved so that the root starts where it rests: nothing here needs a floor."""
    bones = body.bone_poses(motion.poses, motion.trans, leg_length=motion.leg_length)
    return BonePoses(bones.rotations, bones.root - bones.root[0] + body.joints_rest[0])


def _simulated(
    worn: _Worn,
    settled: np.ndarray,
    bones: BonePoses,
    *,
    fps: float,
    config: SimulateConfig,
    solver: SolverConfig,
) -> tuple[np.ndarray, np.ndarray]:
    """(T, N, 3) the cloth at every frame of the motion, the first after warming up, and (T - 1,) substeps of each."""
    body = worn.body
    cloth = worn.cloth(config.cloth, solver)
    cloth.place(settled, np.zeros_like(settled), body.rest)
    rest, first = body.rest_pose(), _frame(bones, 0)
    share = np.linspace(0, 1, 1 + max(1, round(solver.warm_up_seconds * fps)))[:, None]
    warm_up = body.interpolate(
        _repeated(rest, len(share)), _repeated(first, len(share)), share * share * (3 - 2 * share)
    )
    whole = BonePoses(
        *(
            np.concatenate(
                [getattr(part, name)[: -1 if part is warm_up else None] for part in (warm_up, bones)]
            )
            for name in ("rotations", "root")
        )
    )
    skin = body.vertices(body.transforms(whole).astype(np.float32))[:, worn.under]
    start = len(share) - 1
    vertices, steps = [], []
    for number in range(1, len(skin)):
        if number > start:
            vertices.append(cloth.vertices)
        count = step_count(skin[max(0, number - 2)], skin[number - 1], skin[number], solver)
        steps.append(count)
        _advance(cloth, worn, _frame(whole, number - 1), _frame(whole, number), substeps=count, fps=fps)
    vertices.append(cloth.vertices)
    return np.stack(vertices), np.array(steps[start:])


@lru_cache(maxsize=4)
def _settled(
    wearer: BodyConfig, kind: GarmentConfig, material: ClothConfig, solver: SolverConfig, fps: float
) -> np.ndarray:
    """(N, 3) the cloth at rest on the resting body, outside it; for every clip, hence computed once a process."""
    worn = _worn(wearer, kind)
    body = worn.body
    cloth = worn.cloth(material, solver)
    for _ in range(round(solver.settle_seconds * fps)):
        for _ in range(solver.min_substeps):
            cloth.step(body.rest, 1 / (fps * solver.min_substeps))
        cloth.place(cloth.vertices, SETTLE_DAMPING * cloth.velocities, body.rest)
    sdf = BodySdf(body.faces, len(body.rest))
    sdf.update(body.rest)
    return push_out(cloth.vertices, sdf)[0]


def _advance(
    cloth: ClothOnBody, worn: _Worn, start: BonePoses, end: BonePoses, *, substeps: int, fps: float
) -> None:
    """One frame: the bones turn evenly from `start` to `end`, and the body's skin with them."""
    share = np.arange(1, substeps + 1)[:, None] / substeps
    between = worn.body.interpolate(_repeated(start, substeps), _repeated(end, substeps), share)
    for skin, held in zip(*worn.stands(between), strict=True):
        cloth.step(skin, 1 / (fps * substeps), held)


def _repeated(bones: BonePoses, frames: int) -> BonePoses:
    """One frame, so many times."""
    return BonePoses(np.repeat(bones.rotations, frames, axis=0), np.repeat(bones.root, frames, axis=0))


def _frame(bones: BonePoses, number: int) -> BonePoses:
    return BonePoses(bones.rotations[number : number + 1], bones.root[number : number + 1])


def _checked(
    body: SkinnedBody, pattern: Mesh, vertices: np.ndarray, moved: np.ndarray, fps: float
) -> tuple[np.ndarray, Quality]:
    """The vertices (T, N, 3) outside the body (T, B, 3) and on the grid, and how good they are."""
    if not np.isfinite(vertices).all():
        return vertices, measure(pattern, vertices, moved, before=np.zeros(0), after=np.zeros(0), fps=fps)
    sdf = BodySdf(body.faces, len(body.rest))
    pushed = []
    for cloth, skin in zip(vertices, moved, strict=True):
        sdf.update(skin)
        pushed.append(push_out(cloth, sdf))
    outside, before, after = (np.stack(values) for values in zip(*pushed, strict=True))
    outside = round_to_grid(outside)
    return outside, measure(pattern, outside, moved, before=before, after=after, fps=fps)
