"""Loss and errors of images whose difference is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imgtransfer.network.loss import map_errors, masked_l1
from imgtransfer.network.maps import ImagePair
from render import PositionBox, encode_normals

BOX = PositionBox(np.array([-1.0, -2, -3]), np.array([1.0, 2, 3]))
MASK = torch.tensor([[[True, True, False], [False, True, True]]])  # four of six pixels


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def pair(positions: torch.Tensor, normals: torch.Tensor) -> ImagePair:
    return ImagePair.encode(positions, normals, MASK, BOX)


def test_the_gradient_is_a_sign_over_the_number_of_covered_values() -> None:
    predicted, truth = random(2, 1, 2, 3, 3).requires_grad_(True), random(2, 1, 2, 3, 3, seed=1)
    masked_l1(predicted, truth, MASK).backward()
    wanted = torch.sign(predicted - truth).detach() * MASK[..., None] / (2 * 4 * 3)
    torch.testing.assert_close(predicted.grad, wanted)


def test_the_loss_is_a_plain_loops_and_grows_with_its_unit() -> None:
    predicted, truth = random(2, 1, 2, 3, 3), random(2, 1, 2, 3, 3, seed=1)
    values = [abs(predicted[b, 0, y, x, c] - truth[b, 0, y, x, c]).item()
              for b in range(2) for y, x in ((0, 0), (0, 1), (1, 1), (1, 2)) for c in range(3)]  # fmt: skip
    loss = masked_l1(predicted, truth, MASK)
    assert loss.item() == pytest.approx(np.mean(values))
    torch.testing.assert_close(masked_l1(1000 * predicted, 1000 * truth, MASK), 1000 * loss)
    torch.testing.assert_close(masked_l1(truth, predicted, MASK), loss)


@pytest.mark.parametrize("degrees", [0.0, 0.01, 30.0, 120.0, 180.0])
def test_errors_in_millimetres_and_degrees_by_hand(degrees: float) -> None:
    positions, normals = 0.1 * random(2, 1, 2, 3, 3), torch.zeros(2, 1, 2, 3, 3, dtype=torch.float64)
    normals[..., 2] = 1
    angle = torch.tensor(degrees, dtype=torch.float64).deg2rad()
    turned = torch.stack([angle.sin(), torch.zeros_like(angle), angle.cos()]).expand_as(normals)
    moved = positions + torch.tensor([0.003, 0, 0.004])
    errors = map_errors(pair(moved, turned), pair(positions, normals), MASK, BOX)
    assert errors["position_mm"] == pytest.approx(5.0)
    assert errors["normal_degrees"] == pytest.approx(degrees, abs=1e-6)


def test_normals_count_by_their_direction_alone_and_the_background_not_at_all() -> None:
    positions, normals = 0.1 * random(1, 1, 2, 3, 3), random(1, 1, 2, 3, 3, seed=1)
    truth = pair(positions, normals)
    outside = ~MASK[..., None]
    wild = ImagePair(
        truth.positions + 9 * outside, encode_normals(0.3 * normals) * MASK[..., None] + 5 * outside
    )
    errors = map_errors(wild, truth, MASK, BOX)
    assert errors["position_mm"] == pytest.approx(0, abs=1e-9)
    assert errors["normal_degrees"] == pytest.approx(0, abs=1e-5)
