"""The deformer `anchordef`: fitted to clips, asked for clips, stored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from imgtransfer.data.clip import Clip
from imgtransfer.deformers.anchordef.anchors import initial_anchors, nearest, tight_anchors
from imgtransfer.deformers.anchordef.config import AnchorDefConfig
from imgtransfer.deformers.anchordef.network import (
    AnchorNetwork,
    Outputs,
    Sizes,
    anchor_transformations,
    deformed,
)
from imgtransfer.deformers.anchordef.objective import Objective
from imgtransfer.deformers.anchordef.training_frames import (
    body_around,
    motion_features,
    simplified_frames,
    training_frames,
)
from imgtransfer.deformers.base import Deformer, FitFolder, check_faces, same_garment
from imgtransfer.deformers.common.rates import at_frames, same_rate
from imgtransfer.deformers.descent import descend
from render import InputError

_FRAMES = 64  # deformed at once in a prediction
_SHARPNESS = (
    4.0  # of the first blend weights: exp(-this × squared distance / that of the farthest of the N' anchors)
)


class AnchorDef(Deformer):
    """AnchorDEF (Zhao et al. 2023): a garment blended from rigid transformations of anchors, which a recurrent network
    reads off the body's motion, with displacements of its vertices before.

    The network is told [θ, t] without where the body stands and which way it faces (`common.body_motion`), so that
    results turn with a clip.
    """

    name: ClassVar[str] = "anchordef"
    Config = AnchorDefConfig
    config: AnchorDefConfig
    network: AnchorNetwork

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        first = same_garment(clips)
        self._check(clips)
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        centres = initial_anchors(first.template.vertices, self.config.anchors, folder.seed)
        neighbours = nearest(centres, first.template.vertices, self.config.vertices_of_anchor)
        frames = training_frames(clips, neighbours, device)
        self.network = self._begin(first, neighbours, frames.features.cpu(), folder.seed).to(device)
        folds = None
        if self.config.simplified_frames:
            folds = simplified_frames(frames, self.config.simplified_frames, self.config.anchors)
        objective = Objective(self.config, self.network, frames, folds, folder.seed)
        descend(
            self.network,
            objective,
            stage=self.name,
            steps=self.config.steps,
            learning_rate=objective.learning_rate,
            folder=folder,
            weight_decay=self.config.weight_decay,
        )

    def predict(self, clip: Clip) -> np.ndarray:
        network = self.network
        check_faces(clip, network.faces.cpu().numpy())
        device = network.alpha.device
        around = body_around(clip, network.neighbours.cpu().numpy())
        fps = network.fps.item()
        resampled = not same_rate(clip.fps, fps)
        features = motion_features(around.motion.at(fps) if resampled else around.motion).to(device)
        if features.shape[1] != network.gru.input_size:
            wanted = (network.gru.input_size - 9) // 6 + 1
            raise InputError(
                f"{clip.name}: poses of {around.motion.joints.shape[1] + 1} joints, and the method was fitted to "
                f"{wanted}; give clips with the skeleton of the training"
            )
        with torch.no_grad():
            outputs = network(features[None])
            values = [value[0].cpu() for value in (outputs.angles, outputs.shifts, outputs.displacements)]
            if resampled:
                values = [
                    torch.from_numpy(at_frames(value.numpy(), clip.n_frames, clip.fps, fps))
                    for value in values
                ]
            template = torch.from_numpy(clip.template.vertices.astype(np.float32)).to(device)
            anchors, weights = network.attention() @ template, network.blend_weights()
            parts = []
            for start in range(0, clip.n_frames, _FRAMES):
                part = slice(start, start + _FRAMES)
                angles, shifts, displacements = (value[part].to(device) for value in values)
                rotation, translation = anchor_transformations(
                    Outputs(angles, shifts, displacements),
                    anchors,
                    network.tight,
                    around.rotation[part].to(device),
                    around.translation[part].to(device),
                )
                parts.append(deformed(template + displacements, weights, rotation, translation).cpu())
        return around.frames.to_world(torch.cat(parts).numpy())

    def tensors(self) -> dict[str, Tensor]:
        return {key: value.cpu() for key, value in self.network.state_dict().items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        try:
            network = AnchorNetwork(
                self.config, _sizes(self.config, tensors), torch.zeros(1, len(tensors["standardise.mean"]))
            )
            network.load_state_dict(tensors, strict=True)
        except (KeyError, IndexError, RuntimeError) as error:
            raise ValueError(f"not what anchordef with these settings has: {error}") from error
        _check_indices(network)
        self.network = network.eval()

    def parameters(self) -> int:
        return sum(value.numel() for value in self.network.parameters())

    def _check(self, clips: Sequence[Clip]) -> None:
        first = clips[0]
        vertices = len(first.template.vertices)
        if self.config.anchors > vertices:
            raise InputError(
                f"method.anchors: {self.config.anchors} anchors, but the garment of {first.name} has {vertices} "
                "vertices; lower it"
            )
        for clip in clips:
            if not same_rate(clip.fps, first.fps):
                raise InputError(
                    f"{clip.name}: {clip.fps:g} frames a second, and {first.name} has {first.fps:g}; anchordef is "
                    "fitted to clips of one rate (it predicts for others), choose clips with data.train.names"
                )
            poses, poses_of_first = clip.skeleton.poses, first.skeleton.poses
            if poses is not None and poses_of_first is not None and poses.shape[1] != poses_of_first.shape[1]:
                raise InputError(
                    f"{clip.name}: poses of {poses.shape[1]} joints, and {first.name} has {poses_of_first.shape[1]}; "
                    "clips to fit to need one skeleton"
                )

    def _begin(self, clip: Clip, neighbours: np.ndarray, features: Tensor, seed: int) -> AnchorNetwork:
        """The network before its first step, on a clip's template with the anchors' neighbours (A, K)."""
        config, template = self.config, clip.template
        places = template.vertices[neighbours].mean(1).astype(np.float64)  # equation 9
        near = nearest(template.vertices, places, config.anchors_of_vertex)
        torch.manual_seed(seed)
        vertices, faces = len(template.vertices), len(template.faces)
        sizes = Sizes(vertices, faces, config.anchors, near.shape[1], neighbours.shape[1])
        network = AnchorNetwork(config, sizes, features)
        squared = np.square(template.vertices[:, None] - places).sum(-1)
        farthest = np.take_along_axis(squared, near[:, -1:], 1)
        with torch.no_grad():
            network.logits.copy_(torch.from_numpy(-_SHARPNESS * squared / np.maximum(farthest, 1e-12)))
            network.neighbours.copy_(torch.from_numpy(neighbours))
            network.anchors_near.copy_(torch.from_numpy(near))
            network.tight.copy_(torch.from_numpy(self._tight(clip, places)))
            network.faces.copy_(torch.from_numpy(template.faces.astype(np.int64)))
            network.fps.fill_(clip.fps)
        return network

    def _tight(self, clip: Clip, anchors: np.ndarray) -> np.ndarray:
        if self.config.strategy != "mixed":
            return np.full(len(anchors), self.config.strategy == "tight")
        joints = clip.skeleton.joints_rest
        if joints is None or len(joints) < 2:
            raise InputError(
                f"{clip.name}: has no joints_rest (J, 3) of several joints, which method.strategy=mixed needs; take "
                "loose or tight"
            )
        return tight_anchors(anchors, joints.astype(np.float64), self.config.tight_within_m)


def _check_indices(network: AnchorNetwork) -> None:
    """Raise ValueError where stored numbers of vertices or anchors are of none that is there."""
    vertices, anchors = network.logits.shape
    for index, count in (
        (network.neighbours, vertices),
        (network.faces, vertices),
        (network.anchors_near, anchors),
    ):
        if index.numel() and not 0 <= int(index.min()) <= int(index.max()) < count:
            raise ValueError(
                f"numbers from {int(index.min())} to {int(index.max())} of {count} vertices or anchors"
            )


def _sizes(config: AnchorDefConfig, tensors: dict[str, Tensor]) -> Sizes:
    return Sizes(
        vertices=tensors["logits"].shape[0],
        faces=tensors["faces"].shape[0],
        anchors=config.anchors,
        anchors_of_vertex=tensors["anchors_near"].shape[1],
        vertices_of_anchor=tensors["alpha"].shape[1],
    )
