"""The same figure with the simulator in place of the network, for comparison."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from imgtransfer.bodies.config import make_body
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.dressing.source import Source, needs_own_garment
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.body_motion.body_sequence import BodySequence
from imgtransfer.simulation.config import GateConfig, SimulateConfig
from imgtransfer.simulation.quality import Quality, faults
from imgtransfer.simulation.run import Progress, Rejected, simulate_clip
from render import InputError, Option
from render.extras import check_installed

_log = logging.getLogger(__name__)
# Gates that only a cloth which has burst fails.
_FINITE = GateConfig(**dict.fromkeys(GateConfig.model_fields, 1e30))


def simulate_source(
    source: Source, config: SimulateConfig, *, anyway: bool = False, progress: Progress | None = None
) -> tuple[Clip, Quality]:
    """The source's body with the configuration's garment, simulated where the source has it; all in memory.

    Args:
        source: two frames or more; of a mesh sequence from the first on.
        config: of one garment and one body.
        anyway: keep the first attempt whatever its gates say, which is logged then, but not one that has burst.
        progress: called as the work goes on.

    Raises:
        InputError: the extra `simulate` is not installed, too few frames, or what `simulate_clip` refuses.
    """
    check_installed("simulate", str(Option("simulate", True)), "newton", "gpytoolbox")
    if len(source.frames) < 2:
        raise InputError(f"{Option('simulate', True)}: two frames or more are wanted, found one")
    if isinstance(source.moved, Motion):
        return _in_place(source.moved, source, config, progress, anyway=anyway)
    if not isinstance(config.garment, TemplateConfig):
        raise needs_own_garment(config.garment, source)
    if source.frames.start != 0 or source.frames.step != 1:
        raise InputError(
            f"{Option('simulate', True)}: a body mesh sequence is simulated from its first frame on, every one of "
            f"them; give {Option('frames', f':{source.frames.stop}')}"
        )
    return _gated(replace(source.moved, frames=len(source.frames)), config, progress, anyway=anyway)


def _gated(
    moved: Motion | BodySequence, config: SimulateConfig, progress: Progress | None, *, anyway: bool
) -> tuple[Clip, Quality]:
    """Simulated, and held to the configuration's gates, or only told of them."""
    if not anyway:
        try:
            return simulate_clip(moved, config, progress=progress)
        except Rejected as error:
            raise InputError(f"{error} ({Option('anyway', True)} keeps it all the same)") from error
    clip, quality = simulate_clip(moved, config.model_copy(update={"gates": _FINITE}), progress=progress)
    for fault in faults(quality, config.gates):
        _log.warning("note: %s: %s", moved.name, fault)
    return clip, quality


def _in_place(
    motion: Motion, source: Source, config: SimulateConfig, progress: Progress | None, *, anyway: bool
) -> tuple[Clip, Quality]:
    """Simulated where all motions begin, and moved to where this one does."""
    numbers = list(source.frames)
    motion = replace(motion, poses=motion.poses[numbers], trans=motion.trans[numbers], fps=source.fps)
    clip, quality = _gated(motion, config, progress, anyway=anyway)
    body = make_body(config.body)
    first = body.bone_poses(motion.poses[:1], motion.trans[:1], leg_length=motion.leg_length).root[0]
    return _moved(clip, first - body.joints_rest[0]), quality


def _moved(clip: Clip, shift: np.ndarray) -> Clip:
    """A clip with a skeleton, moved by (3,) metres."""
    skeleton = clip.skeleton
    assert clip.garment is not None
    assert skeleton.trans is not None
    assert skeleton.joint_transforms is not None
    transforms = skeleton.joint_transforms.copy()
    transforms[..., 3] += shift
    return replace(
        clip,
        garment=Garment((clip.garment.vertices + shift).astype(np.float32)),
        body=replace(clip.body, vertices=(clip.body.vertices + shift).astype(np.float32)),
        skeleton=replace(
            skeleton, trans=(skeleton.trans + shift).astype(np.float32), joint_transforms=transforms
        ),
    )
