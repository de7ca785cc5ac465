"""Simulate one clip: settle, warm up, follow the body, push out, check, store."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np

from fusion import BodySdf
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.config import GarmentConfig, TemplateConfig
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.body_motion.body_sequence import BodySequence
from imgtransfer.simulation.body_motion.dressed_body import BodyMotion, DressedBody, settled
from imgtransfer.simulation.body_motion.skin import step_count
from imgtransfer.simulation.body_motion.skinned import SkinnedBodyMotion
from imgtransfer.simulation.body_motion.unskinned import MeshBodyMotion
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.quality import Quality, faults, measure, push_out
from render import InputError
from render.threads import one_blas_thread

#: Called with what is being done ("settling", "warming up", "simulating", ", finer" after it in a second attempt), how
#: many of its frames are done, and how many it has.
Progress = Callable[[str, int, int], object]


class Rejected(InputError):
    """A clip that failed its gates twice; the message says which."""


@one_blas_thread()
def simulate_clip(
    motion: Motion | BodySequence,
    config: SimulateConfig,
    *,
    progress: Progress | None = None,
) -> tuple[Clip, Quality]:
    """Simulate the garment on the configuration's body that follows a motion, or on a body mesh sequence.

    The clip's template is the garment as it hangs on the resting body, so that what a method must predict is the
    motion's doing and not the fall from the pattern. The cloth's own rest shape is the pattern.

    Every frame is cut into substeps by how far the body moves in it. A clip that fails a gate is simulated again with
    twice the substeps. Vertices left inside the body are pushed out to 1 mm in front of it; positions are rounded to
    the 2⁻¹⁶ m grid, so that data sets store them compactly and exactly.

    Args:
        motion: at any frame rate, or the body's own frames.
        config: of one garment and one body; its `clips` are not looked at.
        progress: called as the work goes on.

    Returns:
        The clip, and what was measured on it.

    Raises:
        Rejected: the second attempt failed, too.
        InputError: files that cannot be read, or a garment that does not fit the body.
    """
    kind = MeshBodyMotion if isinstance(motion, BodySequence) else SkinnedBodyMotion
    body_motion: BodyMotion = kind(motion, config)  # type: ignore[arg-type]
    dressed, moved = body_motion.dressed, body_motion.body
    pattern = dressed.garment.mesh
    told = progress or _nobody
    told("settling", 0, round(config.solver.settle_seconds * config.fps))
    template = round_to_grid(settled(dressed, config.cloth, config.solver, config.fps))
    for attempt, again in ((config.solver, ""), (config.solver.finer(), ", finer")):
        tried = config.model_copy(update={"solver": attempt})
        vertices, steps = _simulated(body_motion, template, tried, told, again)
        vertices, quality = _checked(dressed, vertices, moved, body_motion.fps)
        wrong = faults(quality, config.gates)
        if not wrong:
            break
    else:
        raise Rejected(f"{body_motion.name}: rejected after two attempts: {'; '.join(wrong)}")
    clip = Clip(
        template=Template(vertices=template, faces=pattern.faces.astype(np.int32)),
        garment=Garment(vertices),
        body=Body(rest=round_to_grid(dressed.rest), faces=dressed.faces, vertices=moved),
        fps=body_motion.fps,
        skeleton=body_motion.skeleton(),
        info={
            **body_motion.info(),
            "licence": config.licence,
            "simulator": f"vertex block descent on Newton {version('newton')}, {steps.min()} to {steps.max()} substeps "
            f"(mean {steps.mean():.1f}), {attempt.iterations} iterations",
            "quality": quality.as_text(),
            "garment": _described(config.garment),
        },
        name=simulated_clip_name(config, motion),
    )
    return clip.with_surface(pattern.surface), quality


def simulated_clip_name(config: SimulateConfig, motion: Motion | BodySequence) -> str:
    """What a clip is called in its data set: garment/motion, and the body where it is not the default one."""
    body = "" if isinstance(motion, BodySequence) else config.body.title
    return f"{config.garment.title}/{'_'.join(part for part in (motion.name, body) if part)}"


def _described(garment: GarmentConfig) -> str:
    """A garment's settings for a clip's `info`; of a file only its name, as its folder is nobody else's business."""
    if isinstance(garment, TemplateConfig):
        garment = garment.model_copy(update={"path": Path(garment.path.name)})
        return garment.model_dump_json(exclude_defaults=True)
    return garment.model_dump_json(exclude_unset=True)


def _simulated(
    body_motion: BodyMotion,
    rest: np.ndarray,
    config: SimulateConfig,
    told: Progress,
    again: str,
) -> tuple[np.ndarray, np.ndarray]:
    """(T, N, 3) the cloth at every frame of the clip, the first after warming up, and (T - 1,) substeps of each."""
    dressed, solver = body_motion.dressed, config.solver
    cloth = dressed.cloth(config.cloth, solver)
    cloth.place(rest, np.zeros_like(rest), dressed.rest)
    skin = body_motion.skin
    vertices, steps = [], []
    for number in range(1, len(skin)):
        if number > body_motion.start:
            vertices.append(cloth.vertices)
        count = step_count(skin[max(0, number - 2)], skin[number - 1], skin[number], solver)
        steps.append(count)
        for body, pinned in zip(*body_motion.between(number, count), strict=True):
            cloth.step(body, 1 / (body_motion.fps * count), pinned)
        if number < body_motion.start:
            told(f"warming up{again}", number, body_motion.start)
        else:
            told(f"simulating{again}", number - body_motion.start + 1, len(skin) - body_motion.start)
    vertices.append(cloth.vertices)
    return body_motion.placed(np.stack(vertices)), np.array(steps[body_motion.start :])


def _nobody(stage: str, done: int, frames: int) -> None:
    """Progress that nobody looks at."""


def _checked(
    dressed: DressedBody, vertices: np.ndarray, moved: np.ndarray, fps: float
) -> tuple[np.ndarray, Quality]:
    """The vertices (T, N, 3) outside the body (T, B, 3) and on the grid, and how good they are."""
    pattern, faces, rest = dressed.garment.mesh, dressed.faces, dressed.rest
    if not np.isfinite(vertices).all():
        nothing = np.zeros(0)
        return vertices, measure(
            pattern, vertices, moved, faces, rest=rest, before=nothing, after=nothing, fps=fps
        )
    sdf = BodySdf(faces, len(rest))
    pushed = []
    for cloth, skin in zip(vertices, moved, strict=True):
        sdf.update(skin)
        pushed.append(push_out(cloth, sdf))
    outside, before, after = (np.stack(values) for values in zip(*pushed, strict=True))
    outside = round_to_grid(outside)
    return outside, measure(pattern, outside, moved, faces, rest=rest, before=before, after=after, fps=fps)
