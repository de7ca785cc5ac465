"""A clip's body as the method sees it: seed points frame by frame, in axes that turn with the body's heading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imgtransfer.data.canonical import RootFrames, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.common.rates import at_samples
from imgtransfer.deformers.common.rotations import nearest_rotation
from imgtransfer.deformers.common.surface_motion import surface_motion
from imgtransfer.deformers.motion_guided.model import Before
from imgtransfer.deformers.motion_guided.skinning import Rest, Seeds, local_axes
from render.mesh.normals import vertex_normals


@dataclass(frozen=True, eq=False)
class MovingBody:
    """A body in T frames.

    Args:
        frames: the heading's. fps: frames a second.
        vertices, normals: (T, B, 3) float32 in the heading's axes. seeds: of those, in the same.
    """

    frames: RootFrames
    fps: float
    vertices: Tensor
    normals: Tensor
    seeds: Seeds

    def before(self, frame: int, last: int, history: Sequence[np.ndarray]) -> Before:
        """What a frame is told of the garment before it, in that frame's axes.

        Args:
            frame: t. last: the frame before it; t itself where the body stands still.
            history: the garments (N, 3) of the last three frames in the world, metres, the last one first.

        Returns:
            Of a batch of one frame.
        """
        newest, second, third = (garment.astype(np.float64) for garment in history)
        turn, own = self.frames.rotation[frame], self.frames.rotation[last]
        velocity = self.fps * (newest - second)
        acceleration = self.fps**2 * (newest - 2 * second + third)
        return Before(
            points=_float((newest - self.frames.translation[frame]) @ turn)[None],
            velocity=_float(velocity @ turn)[None],
            acceleration=_float(acceleration @ turn)[None],
            own_points=_float((newest - self.frames.translation[last]) @ own)[None],
            seeds=self.seeds.points[last][None],
        )


def moving_body(clip: Clip, chosen: np.ndarray, fps: float | None = None) -> MovingBody:
    """The body of a clip.

    Args:
        chosen: (J,) body vertices, the seed points.
        fps: another rate to see it at, between whose frames vertices move linearly.
    """
    frames, vertices = root_frames(clip, "heading"), clip.body.vertices
    if fps is not None:
        rotation, translation, vertices = (
            at_samples(values, clip.fps, fps) for values in (frames.rotation, frames.translation, vertices)
        )
        frames = RootFrames(nearest_rotation(rotation), translation)
    canonical = frames.to_canonical(vertices)
    posed = torch.from_numpy(canonical)
    normals = vertex_normals(posed, torch.from_numpy(clip.body.faces.astype(np.int64)))
    rotation, translation = surface_motion(clip.body, chosen, canonical)
    index = torch.from_numpy(chosen)
    seeds = Seeds(posed[:, index], normals[:, index], _float(rotation), _float(translation))
    return MovingBody(frames, fps or clip.fps, posed, normals, seeds)


def at_rest(clip: Clip, chosen: np.ndarray) -> Rest:
    """The template and the seed points at rest."""
    return Rest(
        _float(clip.template.vertices),
        torch.from_numpy(local_axes(clip.template)),
        _float(clip.body.rest[chosen]),
    )


def _float(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, np.float32))
