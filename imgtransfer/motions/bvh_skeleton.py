"""A BVH file's joints in motion, in its own axes and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from imgtransfer.motions.bvh_text import BvhText, parse_bvh
from imgtransfer.motions.frame_rates import rate_of_frame_time
from imgtransfer.motions.skeletons import ancestors
from render import InputError


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A BVH file's joints in motion.

    text: what the file says. fps: frames a second, at least two frames. local: (T, J, 3, 3) rotations against the
    parent. rest: (J, 3) positions where no joint is turned, from the root's offset on.
    """

    text: BvhText
    fps: float
    local: np.ndarray
    rest: np.ndarray

    @cached_property
    def rotations(self) -> np.ndarray:
        """(T, J, 3, 3) from where no joint is turned, in the file's world."""
        turned = self.local.copy()
        for joint, parent in enumerate(self.text.parents):
            if parent >= 0:
                turned[:, joint] = turned[:, parent] @ turned[:, joint]
        return turned

    def path(self, joint: int) -> np.ndarray:
        """(T, 3) positions of a joint in the file's world.

        A joint's position channels stand in place of its offset, as the format has it; so the path may be in the
        root's, in a joint's below, or in both.
        """
        place = np.zeros((len(self.local), 3))
        for number in reversed(ancestors(joint, self.text.parents)):
            parent = self.text.parents[number]
            moved = _positions(self.text, number)
            place = moved if parent < 0 else place + (self.rotations[:, parent] @ moved[..., None])[..., 0]
        return place

    def moves(self, joint: int) -> bool:
        """Whether the file has positions for a joint or one that it hangs from."""
        chain = ancestors(joint, self.text.parents)
        return any(channel.endswith("position") for above in chain for channel in self.text.channels[above])


def read_skeleton(path: Path) -> Skeleton:
    """Read a BVH file.

    Raises:
        InputError: not a whole BVH file, or one of fewer than two frames or without a frame rate.
    """
    text = parse_bvh(path)
    try:
        fps = rate_of_frame_time(text.frame_time)
    except ValueError as error:
        raise InputError(f"{path}: not a readable BVH file (Frame Time: {error})") from error
    except OverflowError:
        fps = 0.0
    seconds = float(text.frame_time)
    if len(text.values) < 2 or not seconds > 0:
        raise InputError(
            f"{path}: {len(text.values)} frames of {seconds} s; two or more, and a frame time, are wanted"
        )
    return Skeleton(text, fps, _local_rotations(text), _rest(text))


def _first_channels(text: BvhText) -> list[int]:
    """The column of each joint's first channel."""
    return [0, *np.cumsum([len(channels) for channels in text.channels])][:-1]


def _local_rotations(text: BvhText) -> np.ndarray:
    """(T, J, 3, 3) the product of each joint's rotation channels, in their order."""
    frames = len(text.values)
    local = np.broadcast_to(np.eye(3), (frames, len(text.names), 3, 3)).copy()
    for joint, (first, channels) in enumerate(zip(_first_channels(text), text.channels, strict=True)):
        turns = [
            (channel[0], first + i) for i, channel in enumerate(channels) if channel.endswith("rotation")
        ]
        for start in range(0, len(turns), 3):
            # Capital letters: each turns about the axes as the ones before have turned them.
            axes, columns = zip(*turns[start : start + 3], strict=True)
            local[:, joint] = local[:, joint] @ _euler("".join(axes), text.values[:, columns])
    return local


def _euler(axes: str, degrees: np.ndarray) -> np.ndarray:
    """(T, 3, 3) intrinsic rotations by (T, len(axes)) degrees about any axes in turn."""
    if len(axes) == 3 and axes[0] != axes[1] != axes[2]:
        return Rotation.from_euler(axes, degrees, degrees=True).as_matrix()
    turned = Rotation.identity(len(degrees))
    for axis, of_axis in zip(axes, degrees.T, strict=True):
        turned *= Rotation.from_euler(axis, of_axis, degrees=True)
    return turned.as_matrix()


def _positions(text: BvhText, joint: int) -> np.ndarray:
    """(T, 3) of a joint against its parent: its position channels, and its offset where it has none."""
    moved = np.broadcast_to(text.offsets[joint], (len(text.values), 3)).copy()
    first = _first_channels(text)[joint]
    for number, channel in enumerate(text.channels[joint]):
        if channel.endswith("position"):
            moved[:, "XYZ".index(channel[0])] = text.values[:, first + number]
    return moved


def _rest(text: BvhText) -> np.ndarray:
    """(J, 3) positions where no joint is turned."""
    rest = text.offsets.copy()
    for joint, parent in enumerate(text.parents):
        if parent >= 0:
            rest[joint] += rest[parent]
    return rest


def below(root: int, parents: Sequence[int]) -> list[int]:
    """A joint and all that hang from it, in order."""
    inside = {root}
    for joint, parent in enumerate(parents):
        if parent in inside:
            inside.add(joint)
    return sorted(inside)
