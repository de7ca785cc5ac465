"""Clips of a body in motion whose frames are made when they are asked for; how the garment moves is not known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from imgtransfer.bodies.skinned import BonePoses, SkinnedBody
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Skeleton, Template
from imgtransfer.motions.motion import Motion
from render import MeshSequence

_TOGETHER = 32  # frames that are posed together


@dataclass(frozen=True, eq=False, kw_only=True)
class PosedReader:
    """A body with a skeleton in a motion, where the motion's file has it.

    Args:
        name: the clip's. template: the garment on the resting body.
        body: wears it. motion: at any frame rate. frames: which of the motion's frames are the clip's.
        fps: frames a second of the clip.
        info: what the clip says of itself.
    """

    name: str
    template: Template
    body: SkinnedBody
    motion: Motion
    frames: range
    fps: float
    info: Mapping[str, str] = field(default_factory=dict)

    @property
    def n_frames(self) -> int:
        return len(self.frames)

    @property
    def frames_per_chunk(self) -> int:
        return _TOGETHER

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        """The clip with only the frames from `start` to `stop`; all of them by default."""
        motion, numbers = self.motion, list(self.frames[start:stop])
        poses = motion.poses[numbers]
        bones = self.body.bone_poses(poses, motion.trans[numbers], leg_length=motion.leg_length)
        return self._clip(poses, bones)

    def parts(self, count: int) -> Iterator[Clip]:
        """All frames in order, `count` at a time; the last part may be shorter."""
        return (self.clip(first, first + count) for first in range(0, self.n_frames, count))

    def _clip(self, poses: np.ndarray, bones: BonePoses) -> Clip:
        body = self.body
        transforms = body.transforms(bones)
        return Clip(
            template=self.template,
            garment=None,
            body=Body(rest=body.rest, faces=body.faces, vertices=body.vertices(transforms)),
            fps=self.fps,
            skeleton=Skeleton(
                poses=poses.astype(np.float32),
                trans=(bones.root - body.joints_rest[0]).astype(np.float32),
                joints_rest=body.joints_rest.astype(np.float32),
                parents=body.parents,
                blend_weights=body.blend_weights,
                joint_transforms=transforms.astype(np.float32),
            ),
            info=dict(self.info),
            name=self.name,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class MeshReader:
    """The user's own body in motion; arguments as of `PosedReader`.

    Args:
        body: at rest and in all frames that are wanted, metres, y up.
    """

    name: str
    template: Template
    body: MeshSequence
    fps: float
    info: Mapping[str, str] = field(default_factory=dict)

    @property
    def n_frames(self) -> int:
        return self.body.n_frames

    @property
    def frames_per_chunk(self) -> int:
        return 1

    def clip(self, start: int = 0, stop: int | None = None) -> Clip:
        """The clip with only the frames from `start` to `stop`; all of them by default."""
        return self._clip(self.body.frames(range(self.n_frames)[start:stop]))

    def parts(self, count: int) -> Iterator[Clip]:
        """All frames in order, `count` at a time; the last part may be shorter."""
        return map(self._clip, self.body.parts(count))

    @cached_property
    def _rest(self) -> np.ndarray:
        return self.body.mesh.vertices.astype(np.float32)

    def _clip(self, vertices: np.ndarray) -> Clip:
        body = Body(rest=self._rest, faces=self.body.faces, vertices=vertices.astype(np.float32))
        return Clip(
            template=self.template,
            garment=None,
            body=body,
            fps=self.fps,
            info=dict(self.info),
            name=self.name,
        )
