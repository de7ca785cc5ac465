"""Linear blend skinning by virtual bones that turn about where they rest, and what networks predict of such bones."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor, nn

from imgtransfer.deformers.common.rigid_bones import Bones
from imgtransfer.deformers.common.rotations import mean_rotation, rotation_matrices

_LEAST_SCALE = 1e-3  # of what a network's unit means: radians, and metres


class BoneSkinning(nn.Module):
    """Equation 1 of JointNet, G_{T,i} = sum_v w^{i,v} (R_v G_{S,i} + T_v), for bones that rest amid their vertices.

    A bone rests at p_v, the mean of the template's vertices by how much it moves them, and is given by its turn R_v and
    offset d_v, so that T_v = p_v + d_v - R_v p_v. For another body's template bones rest elsewhere and turn alike
    (section 4.5: "moving virtual bones based on the differences in body shapes").

    A network's six numbers a bone are a rotation vector and an offset, both against the bone's mean of the training and
    in units of how much they vary there. The paper has Euler angles, which jump.

    Args:
        weights: W, (N, V).
    """

    weights: Tensor
    mean_turn: Tensor
    mean_offset: Tensor
    turn_scale: Tensor
    offset_scale: Tensor

    def __init__(self, weights: Tensor) -> None:
        super().__init__()
        count = weights.shape[1]
        self.register_buffer("weights", weights.clone())
        self.register_buffer("mean_turn", torch.eye(3).repeat(count, 1, 1))
        self.register_buffer("mean_offset", torch.zeros(count, 3))
        self.register_buffer("turn_scale", torch.ones(count, 1))
        self.register_buffer("offset_scale", torch.ones(count, 1))

    def places(self, template: Tensor) -> Tensor:
        """p, (..., V, 3), of a template (..., N, 3)."""
        return self.weights.T @ template / self.weights.sum(0).clamp(min=1e-12)[:, None]

    def standardise(self, turn: Tensor, offset: Tensor) -> None:
        """Take means and scales from bones in motion (S, V, 3, 3), (S, V, 3)."""
        mean = mean_rotation(turn.double().numpy())
        from_mean = turn.double().numpy() @ mean.swapaxes(-1, -2)
        vectors = Rotation.from_matrix(from_mean.reshape(-1, 3, 3)).as_rotvec().reshape(*offset.shape)
        self.mean_turn.copy_(torch.from_numpy(mean))
        self.turn_scale[:, 0] = _spread(torch.from_numpy(vectors))
        self.mean_offset.copy_(offset.mean(0))
        self.offset_scale[:, 0] = _spread(offset - offset.mean(0))

    def bones(self, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Turns (..., V, 3, 3) and offsets (..., V, 3), metres, from a network's numbers (..., V, 6)."""
        turn = rotation_matrices(numbers[..., :3] * self.turn_scale) @ self.mean_turn
        return turn, self.mean_offset + numbers[..., 3:] * self.offset_scale

    def forward(self, turn: Tensor, offset: Tensor, places: Tensor, rest: Tensor) -> Tensor:
        """Vertices (F, N, 3).

        Args:
            turn: (F, V, 3, 3). offset: (F, V, 3).
            places: p, (V, 3) or (F, V, 3). rest: G_S, (N, 3) or (F, N, 3).
        """
        shift = places + offset - (turn @ places[..., None])[..., 0]
        blended = self.weights @ torch.cat([turn, shift[..., None]], -1).flatten(-2)  # (F, N, 12)
        matrices = blended.unflatten(-1, (3, 4))
        return (matrices[..., :3] @ rest[..., None])[..., 0] + matrices[..., 3]


def bones_about(bones: Bones, places: np.ndarray) -> tuple[Tensor, Tensor]:
    """Turns (T, V, 3, 3) and offsets (T, V, 3) float32 of bones about the places (V, 3) where they rest."""
    offset = (bones.rotation @ places[:, None, :, None])[..., 0] + bones.translation - places[:, None]
    turn = torch.from_numpy(np.ascontiguousarray(bones.rotation.swapaxes(0, 1), np.float32))
    return turn, torch.from_numpy(np.ascontiguousarray(offset.swapaxes(0, 1), np.float32))


def _spread(deviations: Tensor) -> Tensor:
    """(S, V, 3) -> (V,), root mean square of the coordinates."""
    return deviations.float().square().mean((0, 2)).sqrt().clamp(min=_LEAST_SCALE)
