"""The frames that AnchorDEF is fitted to, as tensors in the canonical frame of each one's root."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from imgtransfer.data.canonical import RootFrames, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.anchordef.simplification import simplified
from imgtransfer.deformers.common.body_motion import BodyMotion, body_motion, joint_features, root_features
from imgtransfer.deformers.common.surface_motion import surface_motion
from render.mesh.normals import vertex_normals


@dataclass(frozen=True, eq=False)
class BodyAround:
    """What a body says of a garment's frames.

    Args:
        frames: of the root. motion: of the joints.
        rotation: (T, A, 3, 3) and translation: (T, A, 3) float32, R_body and T_body of each anchor's nearest body
            vertex in the canonical frame (equation 4).
    """

    frames: RootFrames
    motion: BodyMotion
    rotation: Tensor
    translation: Tensor


def body_around(clip: Clip, neighbours: np.ndarray) -> BodyAround:
    """The body of a clip as anchors see it.

    Args:
        neighbours: (A, K) of the template's vertices, whose mean is where an anchor looks for its body vertex.

    Raises:
        InputError: a clip without poses.
    """
    frames = root_frames(clip, "root")
    places = clip.template.vertices[neighbours].mean(1)
    _, vertices = cKDTree(clip.body.rest).query(places)
    rotation, translation = surface_motion(clip.body, vertices, frames.to_canonical(clip.body.vertices))
    return BodyAround(frames, body_motion(clip, frames), _float(rotation), _float(translation))


def motion_features(motion: BodyMotion) -> Tensor:
    """(T, 9 + 6 (J - 1)) float32, [θ, t] as the network reads it: the root's motion, then the joints' rotations."""
    joints = joint_features(motion).reshape(len(motion), -1)
    return torch.from_numpy(np.concatenate([root_features(motion), joints], axis=1))


@dataclass(frozen=True, eq=False)
class TrainingFrames:
    """All frames of all clips, one clip after the other.

    Args:
        lengths: frames of each clip. clip: (T,) int64, the clip of each frame.
        templates: (C, N, 3) of each clip. faces: (F, 3).
        features: (T, features).
        garment: (T, N, 3) the truth, canonical.
        rotation, translation: (T, A, 3, 3) and (T, A, 3) of the anchors' body vertices.
        body_points, body_normals: (T, N, 3) of each garment vertex's nearest body vertex.
    """

    lengths: list[int]
    clip: Tensor
    templates: Tensor
    faces: Tensor
    features: Tensor
    garment: Tensor
    rotation: Tensor
    translation: Tensor
    body_points: Tensor
    body_normals: Tensor


def training_frames(clips: Sequence[Clip], neighbours: np.ndarray, device: torch.device) -> TrainingFrames:
    """Read clips for a fit.

    Args:
        neighbours: (A, K) of the template's vertices.

    Raises:
        InputError: a clip without poses.
    """
    columns: dict[str, list[Tensor]] = {}
    for clip in clips:
        assert clip.garment is not None
        around = body_around(clip, neighbours)
        garment = around.frames.to_canonical(clip.garment.vertices)
        points, normals = _nearest_surface(
            garment, around.frames.to_canonical(clip.body.vertices), clip.body.faces
        )
        parts = {
            "features": motion_features(around.motion),
            "garment": torch.from_numpy(garment),
            "rotation": around.rotation,
            "translation": around.translation,
            "body_points": points,
            "body_normals": normals,
        }
        for key, value in parts.items():
            columns.setdefault(key, []).append(value)
    lengths = [clip.n_frames for clip in clips]
    return TrainingFrames(
        lengths=lengths,
        clip=torch.repeat_interleave(torch.arange(len(clips)), torch.tensor(lengths)).to(device),
        templates=torch.stack([_float(clip.template.vertices) for clip in clips]).to(device),
        faces=torch.from_numpy(clips[0].template.faces.astype(np.int64)).to(device),
        **{key: torch.cat(values).to(device) for key, values in columns.items()},
    )


@dataclass(frozen=True, eq=False)
class SimplifiedFrames:
    """Garments in some frames, and the same with few vertices left.

    Args:
        garment: (S, N, 3). vertices: (S, M, 3), with zeros after those that are there. valid: (S, M) bool.
    """

    garment: Tensor
    vertices: Tensor
    valid: Tensor


def simplified_frames(frames: TrainingFrames, count: int, vertices: int) -> SimplifiedFrames:
    """Frames spread evenly over all, with each one's garment simplified to `vertices` vertices."""
    total = len(frames.garment)
    chosen = torch.linspace(0, total - 1, min(count, total)).round().long().unique()
    garment = frames.garment[chosen.to(frames.garment.device)]
    faces = frames.faces.cpu().numpy()
    meshes = [_float(simplified(one, faces, vertices)[0]) for one in garment.cpu().numpy()]
    padded = torch.nn.utils.rnn.pad_sequence(meshes, batch_first=True)
    sizes = torch.tensor([len(mesh) for mesh in meshes])
    valid = torch.arange(padded.shape[1]) < sizes[:, None]
    return SimplifiedFrames(garment, padded.to(garment.device), valid.to(garment.device))


def _nearest_surface(garment: np.ndarray, body: np.ndarray, faces: np.ndarray) -> tuple[Tensor, Tensor]:
    """Place and normal (T, N, 3) of the body vertex nearest to each vertex of the true garment."""
    points, normals = np.empty_like(garment), np.empty_like(garment)
    corners = torch.from_numpy(faces.astype(np.int64))
    for frame, (cloth, pose) in enumerate(zip(garment, body, strict=True)):
        _, nearest = cKDTree(pose).query(cloth)
        points[frame] = pose[nearest]
        normals[frame] = vertex_normals(torch.from_numpy(pose), corners).numpy()[nearest]
    return torch.from_numpy(points), torch.from_numpy(normals)


def _float(values: np.ndarray) -> Tensor:
    return torch.from_numpy(np.asarray(values, np.float32))
