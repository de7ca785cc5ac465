"""The same figure with the simulator in place of the network, for comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imgtransfer.bodies.config import make_body
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.dressing.source import Progress, Source, needs_own_garment
from imgtransfer.garments.config import TemplateConfig
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.quality import Quality
from imgtransfer.simulation.run import simulate_clip
from render import InputError, Option
from render.extras import check_installed


def simulate_source(
    source: Source, config: SimulateConfig, *, progress: Progress | None = None
) -> tuple[Clip, Quality]:
    """The source's body with the configuration's garment, simulated where the source has it; all in memory.

    Args:
        source: two frames or more; of a mesh sequence from the first on.
        config: of one garment and one body.
        progress: called with a number of frames when they are done.

    Raises:
        InputError: the extra `simulate` is not installed, too few frames, or what `simulate_clip` refuses.
    """
    check_installed("simulate", str(Option("simulate", True)), "newton", "gpytoolbox")
    if len(source.frames) < 2:
        raise InputError(f"{Option('simulate', True)}: two frames or more are wanted, found one")
    if isinstance(source.moved, Motion):
        return _in_place(source.moved, source, config, progress)
    if not isinstance(config.garment, TemplateConfig):
        raise needs_own_garment(config.garment, source)
    if source.frames.start != 0 or source.frames.step != 1:
        raise InputError(
            f"{Option('simulate', True)}: a body mesh sequence is simulated from its first frame on, every one of "
            f"them; give {Option('frames', f':{source.frames.stop}')}"
        )
    return simulate_clip(replace(source.moved, frames=len(source.frames)), config, progress=progress)


def _in_place(
    motion: Motion, source: Source, config: SimulateConfig, progress: Progress | None
) -> tuple[Clip, Quality]:
    """Simulated where all motions begin, and moved to where this one does."""
    numbers = list(source.frames)
    motion = replace(motion, poses=motion.poses[numbers], trans=motion.trans[numbers], fps=source.fps)
    clip, quality = simulate_clip(motion, config, progress=progress)
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
