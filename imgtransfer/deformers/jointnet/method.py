"""The method `jointnet`: Diao, Xiao, He and Jiang 2024, "Combating spurious correlations in loose-fitting garment
animation through joint-specific feature learning". Sections and equations here are that paper's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor, nn

from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.carriers import Carried
from imgtransfer.deformers.common.descent_config import VertexDescentConfig
from imgtransfer.deformers.common.fitting import Draw, fit_stage
from imgtransfer.deformers.common.sequence import FitClips, Given, Known, SequenceDeformer
from imgtransfer.deformers.common.virtual_rig import Rig, carried_by, virtual_rig
from imgtransfer.deformers.common.windows import Batch
from imgtransfer.deformers.jointnet.config import JointNetConfig
from imgtransfer.deformers.jointnet.joint_gru import joint_inputs, neighbour_joints
from imgtransfer.deformers.jointnet.loss import ClothLoss
from imgtransfer.deformers.jointnet.network import BoneNetwork, Displacements

Drawn = Callable[[int], tuple[Batch, Tensor]]  # the windows of a step, and places of frames in them
_AT_ONCE = 32  # frames whose vertices are computed together


class BothStages(nn.Module):
    """The whole network: bones, and displacements in the canonical space before they are skinned."""

    def __init__(self, low: BoneNetwork, high: Displacements) -> None:
        super().__init__()
        self.low, self.high = low, high

    def skinned(self, memory: Tensor, template: Tensor, carried: Carried) -> Tensor:
        """Equations 1 and 4: the template moved by the bones alone, (F, N, 3) in the root's frame.

        Args:
            memory: (F, J, H) of the joints. template: G_S, (N, 3) or (F, N, 3). carried: the bones in these frames.
        """
        return self._moved(self.low.features(memory), template, template, carried)

    def forward(self, memory: Tensor, template: Tensor, carried: Carried) -> Tensor:
        """The same with displacements (equation 5)."""
        features = self.low.features(memory)
        return self._moved(features, template + self.high(features), template, carried)

    def _moved(self, features: Tensor, rest: Tensor, template: Tensor, carried: Carried) -> Tensor:
        skinning = self.low.skinning
        bones = carried.put(*skinning.bones(self.low.numbers(features)))
        return skinning(*bones, skinning.places(template), rest)


class JointNet(SequenceDeformer):
    """Joint-wise features, a sparse association of joints with virtual bones, and joint-specific displacements."""

    name = "jointnet"
    Config = JointNetConfig
    config: JointNetConfig

    def _fitted(self, clips: FitClips, folder: FitFolder) -> nn.Module:
        rig = virtual_rig(clips, self.config.rig, folder)
        torch.manual_seed(folder.seed)
        neighbours = torch.from_numpy(neighbour_joints(clips.known.parents))
        network = self._made(clips.known, joint_inputs(clips.root, clips.joints, neighbours), rig.skinning())
        low, high = self.config.low, self.config.high
        terms = self._terms(network, network.skinned, clips, rig, _drawn(clips, low, folder.seed))
        fit_stage(network.low, terms, "low", low, folder)
        terms = self._terms(network, network, clips, rig, _drawn(clips, high, folder.seed + 1))
        fit_stage(network, terms, "high", high, folder)
        return network

    def _terms(
        self,
        network: BothStages,
        predict: Callable[..., Tensor],
        clips: FitClips,
        rig: Rig,
        draw: Drawn,
    ) -> Callable[[int], dict[str, Tensor]]:
        """The objective of a step, where `predict` makes vertices as `BothStages.forward` does."""
        objective = ClothLoss(clips.known.faces, len(clips.known.template), self.config)

        def terms(step: int) -> dict[str, Tensor]:
            batch, places = draw(step)
            memory = network.low.memory(clips.root[batch.frames], clips.joints[batch.frames])
            frames = batch.frames.flatten()[places]
            template = clips.templates[clips.clip_of[frames]]
            got = predict(memory.flatten(0, 1)[places], template, rig.carried.of(frames))
            return objective(got, clips.positions[frames], network.low.active())

        return terms

    def _made(self, known: Known, features: Tensor, skinning: BoneSkinning) -> BothStages:
        template = torch.from_numpy(known.template)
        neighbours = torch.from_numpy(neighbour_joints(known.parents))
        low = BoneNetwork(features, neighbours, skinning, template, self.config)
        return BothStages(low, Displacements(len(known.parents), len(template), self.config))

    def _empty(self, known: Known, tensors: dict[str, Tensor]) -> nn.Module:
        features = torch.zeros(1, *tensors["low.standardise.mean"].shape)
        return self._made(known, features, BoneSkinning(torch.zeros_like(tensors["low.skinning.weights"])))

    def _canonical(self, network: nn.Module, given: Given) -> Tensor:
        assert isinstance(network, BothStages)
        memory = network.low.whole(given.root, given.joints, self.config.low.warm_up_frames)
        carried = carried_by(self.config.rig, given, network.low.skinning.places(given.template))
        parts = torch.arange(len(memory)).split(_AT_ONCE)
        return torch.cat([network(memory[frames], given.template, carried.of(frames)) for frames in parts])


def _drawn(clips: FitClips, config: VertexDescentConfig, seed: int) -> Drawn:
    """The batch of each step, and the places of the frames in it whose vertices are compared."""
    return partial(Draw(clips.lengths, config, seed).with_frames, most=config.loss_frames)
