"""The method `virtual_bones`: Pan et al. 2022, "Predicting loose-fitting garment deformations using bone-driven motion
networks", as section 3.1 and the ablations of JointNet (Diao et al. 2024) describe it.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.fitting import Draw, fit_stage
from imgtransfer.deformers.common.sequence import FitClips, Given, Known, SequenceDeformer
from imgtransfer.deformers.common.virtual_rig import Rig, carried_by, virtual_rig
from imgtransfer.deformers.virtual_bones.bone_motion import BoneMotion
from imgtransfer.deformers.virtual_bones.config import VirtualBonesConfig
from imgtransfer.deformers.virtual_bones.displacements import Displacements, neighbours_of
from render import Mesh

_AT_ONCE = 32  # frames whose vertices are computed together
_RESIDUAL_FRAMES = 256  # of which the mean displacement is taken


class TwoStages(nn.Module):
    """Both networks, as they are stored."""

    def __init__(self, low: BoneMotion, high: Displacements) -> None:
        super().__init__()
        self.low, self.high = low, high


class VirtualBones(SequenceDeformer):
    """Virtual bones, their motion from that of all joints, and displacements of vertices."""

    name = "virtual_bones"
    Config = VirtualBonesConfig
    config: VirtualBonesConfig

    def _fitted(self, clips: FitClips, folder: FitFolder) -> nn.Module:
        rig = virtual_rig(clips, self.config.rig, folder)
        torch.manual_seed(folder.seed)
        features = torch.cat([clips.root, clips.joints.flatten(1)], 1)
        low = self._low(features, rig.skinning(), clips.templates[0])
        self._fit_low(low, clips, rig, features, folder)
        torch.manual_seed(folder.seed + 1)
        high = self._fit_high(low, clips, rig, features, folder)
        return TwoStages(low, high)

    def _low(self, features: Tensor, skinning: BoneSkinning, template: Tensor) -> BoneMotion:
        return BoneMotion(
            features, skinning, template, hidden=self.config.hidden, dropout=self.config.dropout
        )

    def _high(self, numbers: Tensor, residuals: Tensor, faces: np.ndarray, template: Tensor) -> Displacements:
        mesh = Mesh(template.double().numpy(), faces, "garment")
        lengths = np.linalg.norm(mesh.vertices[mesh.edges[:, 0]] - mesh.vertices[mesh.edges[:, 1]], axis=1)
        return Displacements(
            numbers,
            residuals,
            neighbours_of(mesh.edges, len(template)),
            float(lengths.mean()),
            hidden=self.config.hidden,
            dropout=self.config.dropout,
            vertex_features=self.config.vertex_features,
            edge_features=self.config.edge_features,
        )

    def _fit_low(
        self, low: BoneMotion, clips: FitClips, rig: Rig, features: Tensor, folder: FitFolder
    ) -> None:
        draw = Draw(clips.lengths, self.config.low, folder.seed)

        def loss(step: int) -> dict[str, Tensor]:
            batch = draw(step)
            numbers = low.numbers(low.memory(features[batch.frames])[batch.counted])
            chosen = batch.frames[batch.counted]
            return {"bones_cm2": low.loss(numbers, rig.turn[chosen], rig.offset[chosen])}

        fit_stage(low, loss, "low", self.config.low, folder)

    def _fit_high(
        self, low: BoneMotion, clips: FitClips, rig: Rig, features: Tensor, folder: FitFolder
    ) -> Displacements:
        with torch.no_grad():
            parts = [
                low.numbers(low.memory.whole(part, self.config.low.warm_up_frames))
                for part in features.split(list(clips.lengths))
            ]
            numbers = torch.cat(parts)
            some = np.linspace(0, len(numbers) - 1, min(len(numbers), _RESIDUAL_FRAMES)).round()
            residuals = self._residuals(low, clips, rig, numbers, torch.from_numpy(some.astype(np.int64)))[0]
        high = self._high(numbers.flatten(1), residuals, clips.known.faces, clips.templates[0])
        draw = Draw(clips.lengths, self.config.high, folder.seed + 1)

        def loss(step: int) -> dict[str, Tensor]:
            batch, places = draw.with_frames(step, self.config.high.loss_frames)
            memory = high.memory(numbers[batch.frames].flatten(2))
            frames = batch.frames.flatten()[places]
            with torch.no_grad():
                residual, mesh, template = self._residuals(low, clips, rig, numbers, frames)
            error = high(memory.flatten(0, 1)[places], mesh, template) - residual
            return {"vertices_cm2": 1e4 * error.square().sum(-1).mean()}

        fit_stage(high, loss, "high", self.config.high, folder)
        return high

    @staticmethod
    def _residuals(
        low: BoneMotion, clips: FitClips, rig: Rig, numbers: Tensor, frames: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """What the low-frequency stage leaves, its mesh, and the template; of frames (F,), (F, N, 3) each."""
        template = clips.templates[clips.clip_of[frames]]
        skinning = low.skinning
        bones = rig.carried.of(frames).put(*skinning.bones(numbers[frames]))
        mesh = skinning(*bones, skinning.places(template), template)
        return clips.positions[frames] - mesh, mesh, template

    def _empty(self, known: Known, tensors: dict[str, Tensor]) -> nn.Module:
        template = torch.from_numpy(known.template)
        weights = torch.zeros_like(tensors["low.skinning.weights"])
        features = torch.zeros(1, len(tensors["low.memory.standardise.mean"]))
        low = self._low(features, BoneSkinning(weights), template)
        numbers = torch.zeros(1, 6 * weights.shape[1])
        return TwoStages(low, self._high(numbers, torch.zeros(1, *template.shape), known.faces, template))

    def _canonical(self, network: nn.Module, given: Given) -> Tensor:
        assert isinstance(network, TwoStages)
        low, high = network.low, network.high
        features = torch.cat([given.root, given.joints.flatten(1)], 1)
        numbers = low.numbers(low.memory.whole(features, self.config.low.warm_up_frames))
        memory = high.memory.whole(numbers.flatten(1), self.config.high.warm_up_frames)
        places = low.skinning.places(given.template)
        carried = carried_by(self.config.rig, given, places)
        parts = []
        for frames in torch.arange(len(numbers)).split(_AT_ONCE):
            bones = carried.of(frames).put(*low.skinning.bones(numbers[frames]))
            mesh = low.skinning(*bones, places, given.template)
            parts.append(mesh + high(memory[frames], mesh, given.template))
        return torch.cat(parts)
