"""The network of JointNet: Ψ, the association φ(A), F and f_V of section 3.2, and the displacements of section 3.3."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.recurrent import Standardise
from imgtransfer.deformers.common.windows import warmed_up
from imgtransfer.deformers.jointnet.config import JointNetConfig
from imgtransfer.deformers.jointnet.joint_gru import JointGru, joint_inputs

_SHAPE_UNIT = 1e-3  # metres, of the numbers in D


class BoneNetwork(nn.Module):
    """The first stage: from the joints' motion to that of the virtual bones (equation 4).

    Args:
        features: (S, J, C) of all training frames, see `joint_inputs`.
        neighbours: (J, 2), see `neighbour_joints`.
        skinning: by V bones.
        template: (N, 3), amid which the bones rest.
    """

    neighbours: Tensor

    def __init__(
        self,
        features: Tensor,
        neighbours: Tensor,
        skinning: BoneSkinning,
        template: Tensor,
        config: JointNetConfig,
    ) -> None:
        super().__init__()
        count, bones = len(neighbours), skinning.weights.shape[1]
        self.register_buffer("neighbours", neighbours)
        self.standardise = Standardise(features)
        self.gru = JointGru(count, features.shape[-1], config.hidden)
        self.dropout = nn.Dropout(config.dropout)
        self.perceptron = JointPerceptron(count, config.hidden, config.joint_features)
        self.association = nn.Parameter(torch.rand(bones, count) * 2 / count)  # A
        self.fourier = FourierFeatures(config.joint_features // 2, config.frequency)
        self.head = perceptron(config.joint_features, config.bone_layers, 6)  # F
        self.skinning = skinning
        self.register_buffer("places", skinning.places(template))

    def memory(self, root: Tensor, joints: Tensor) -> Tensor:
        """(B, L, J, H) of windows (B, L, ...)."""
        return self.dropout(self.gru(self.standardise(joint_inputs(root, joints, self.neighbours))))

    def whole(self, root: Tensor, joints: Tensor, warm_up: int) -> Tensor:
        """(T, J, H) of a whole clip, after its first frame was seen `warm_up` times more."""
        return self.memory(warmed_up(root, warm_up)[None], warmed_up(joints, warm_up)[None])[0, warm_up:]

    def features(self, memory: Tensor) -> Tensor:
        """Ψ, (F, J, K), of memory (F, J, H)."""
        return self.perceptron(memory)

    def active(self) -> Tensor:
        """φ(A) = ReLU(A), (V, J): which joints move which bones, and how much."""
        return torch.relu(self.association)

    def numbers(self, features: Tensor) -> Tensor:
        """F(φ(A) Ψ + f_V), (F, V, 6), see `BoneSkinning.bones`."""
        return self.head(self.active() @ features + self.fourier(self.places))


class Displacements(nn.Module):
    """Joint-specific pose space deformation (equation 5): each joint blends shapes D^j of its own.

    Args:
        joints: J. vertices: N.
    """

    def __init__(self, joints: int, vertices: int, config: JointNetConfig) -> None:
        super().__init__()
        self.blend = perceptron(config.joint_features, config.shape_layers, config.shapes)
        self.shapes = nn.Parameter(torch.zeros(joints * config.shapes, 3 * vertices))  # D

    def forward(self, features: Tensor) -> Tensor:
        """(F, N, 3), metres, to be added to the template before it is skinned; features (F, J, K) are Ψ."""
        return _SHAPE_UNIT * (self.blend(features).flatten(1) @ self.shapes).unflatten(1, (-1, 3))


class FourierFeatures(nn.Module):
    """γ (equation 3): of where bones rest, by which F tells them apart.

    Args:
        count: m. deviation: of the frequencies c, which stay as they are drawn; the coefficients α are learned.
    """

    frequencies: Tensor

    def __init__(self, count: int, deviation: float) -> None:
        super().__init__()
        self.register_buffer("frequencies", deviation * torch.randn(count, 3))
        self.coefficients = nn.Parameter(torch.randn(count))

    def forward(self, places: Tensor) -> Tensor:
        """(V, 3), metres -> (V, 2 m): cosine and sine of each frequency side by side."""
        phase = 2 * math.pi * places @ self.frequencies.T
        waves = torch.stack([phase.cos(), phase.sin()], -1)
        return (self.coefficients[:, None] * waves).flatten(-2)


class JointPerceptron(nn.Module):
    """A linear layer for each joint, and its activation."""

    def __init__(self, joints: int, inputs: int, outputs: int) -> None:
        super().__init__()
        bound = 1 / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(joints, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(joints, outputs).uniform_(-bound, bound))

    def forward(self, values: Tensor) -> Tensor:
        """(F, J, H) -> (F, J, K)."""
        product = torch.bmm(values.transpose(0, 1), self.weight).transpose(0, 1)
        return nn.functional.leaky_relu(product + self.bias, 0.2)


def perceptron(inputs: int, widths: Sequence[int], outputs: int) -> nn.Sequential:
    """Linear layers with leaky ReLUs between them."""
    sizes = [inputs, *widths, outputs]
    layers: list[nn.Module] = []
    for first, second in pairwise(sizes):
        layers += [nn.Linear(first, second), nn.LeakyReLU(0.2)]
    return nn.Sequential(*layers[:-1])
