"""The loss of images and their errors, by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imgtransfer.network import map_errors, masked_l1
from imgtransfer.network.maps import ImagePair
from render import PositionBox


def test_masked_loss_by_hand() -> None:
    predicted, truth = torch.zeros(1, 1, 1, 3, 3), torch.zeros(1, 1, 1, 3, 3)
    predicted[0, 0, 0, 0] = torch.tensor([0.3, 0.0, -0.3])  # covered: 0.6 over 2 covered pixels x 3 channels
    predicted[0, 0, 0, 2] = 100.0  # background
    mask = torch.tensor([[[True, True, False]]])
    torch.testing.assert_close(masked_l1(predicted, truth, mask), torch.tensor(0.1))


def test_masked_loss_ignores_a_background_that_is_not_finite() -> None:
    predicted = torch.full((1, 1, 1, 2, 3), torch.nan)
    predicted[..., 0, :] = 0.5
    predicted.requires_grad_(True)
    loss = masked_l1(predicted, torch.zeros_like(predicted), torch.tensor([[[True, False]]]))
    loss.backward()
    assert loss == 0.5
    assert predicted.grad is not None
    assert torch.equal(predicted.grad[..., 1, :], torch.zeros(1, 1, 1, 3))


def test_masked_loss_of_an_empty_mask_is_zero() -> None:
    assert (
        masked_l1(
            torch.rand(1, 2, 4, 6, 3), torch.rand(1, 2, 4, 6, 3), torch.zeros(2, 4, 6, dtype=torch.bool)
        )
        == 0
    )


def test_map_errors_by_hand() -> None:
    box = PositionBox(np.zeros(3), np.array([1.0, 2.0, 4.0]))
    mask = torch.tensor([[[True, False]]])
    truth = ImagePair(torch.zeros(1, 1, 1, 2, 3), torch.full((1, 1, 1, 2, 3), 0.5))
    truth.normals[..., 0, :] = torch.tensor([0.5, 0.5, 1.0])  # +z
    predicted = ImagePair(truth.positions.clone(), truth.normals.clone())
    predicted.positions[..., 0, :] = torch.tensor([0.003, 0.002, 0.0])  # 3 mm and 4 mm
    predicted.positions[..., 1, :] = 9.0  # background
    predicted.normals[..., 0, :] = torch.tensor([0.6, 0.5, 0.6])  # 45 degrees, too short
    errors = map_errors(predicted, truth, mask, box)
    assert errors == pytest.approx({"position_mm": 5.0, "normal_degrees": 45.0}, rel=1e-4)
