"""The low-frequency stage: from the motion of all joints to that of the virtual bones."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.recurrent import MotionGru


class BoneMotion(nn.Module):
    """One recurrent unit reads all joints at once, and a linear layer gives six numbers of each virtual bone.

    Section 3.2 of JointNet on Pan et al. 2022: "consider body joints as a whole and encode the concatenation of all
    body joints for virtual bones prediction". Where they give joints as rotation vectors and the root by its position,
    the rotations' matrices and the root's velocity and tilt are read here: see `common.body_motion`.

    Args:
        features: (S, C) of the training.
        skinning: by V bones.
        template: (N, 3) of which the bones move the vertices.
        hidden: of the recurrent unit. dropout: see `MotionGru`.
    """

    spread: Tensor
    mass: Tensor

    def __init__(
        self, features: Tensor, skinning: BoneSkinning, template: Tensor, *, hidden: int, dropout: float
    ) -> None:
        super().__init__()
        self.skinning = skinning
        self.memory = MotionGru(features, hidden, dropout)
        self.head = nn.Linear(hidden, 6 * skinning.weights.shape[1])
        mass, spread = bone_spread(skinning, template)
        self.register_buffer("mass", mass)
        self.register_buffer("spread", spread)

    def numbers(self, memory: Tensor) -> Tensor:
        """(..., H) -> (..., V, 6), see `BoneSkinning.bones`."""
        return self.head(memory).unflatten(-1, (-1, 6))

    def loss(self, numbers: Tensor, turn: Tensor, offset: Tensor) -> Tensor:
        """Mean squared distance, in cm², of where bones move the vertices, each bone by itself.

        For one bone it is |d - d*|² + tr((R - R*) C (R - R*)ᵀ), where C is how its vertices spread about it. So an
        error of a turn counts as what it does to vertices, and one that cannot be seen from them does not count.

        Args:
            numbers: (F, V, 6) predicted. turn: (F, V, 3, 3), offset: (F, V, 3) wanted.
        """
        own_turn, own_offset = self.skinning.bones(numbers)
        error = own_turn - turn
        turned = ((error @ self.spread) * error).sum((-1, -2))
        squared = (own_offset - offset).square().sum(-1) + turned
        return 1e4 * (squared * self.mass).sum(-1).mean()


def bone_spread(skinning: BoneSkinning, template: Tensor) -> tuple[Tensor, Tensor]:
    """How much of a template each bone moves, (V,) of sum 1, and how that spreads about the bone, (V, 3, 3), m²."""
    weights = skinning.weights.double()
    total = weights.sum(0)
    away = template.double()[:, None] - skinning.places(template).double()  # (N, V, 3)
    spread = torch.einsum("nv,nva,nvb->vab", weights, away, away) / total.clamp(min=1e-12)[:, None, None]
    return (total / total.sum()).float(), spread.float()
