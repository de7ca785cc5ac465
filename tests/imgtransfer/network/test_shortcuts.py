"""The dense code of a whole view: coarse means, calibration, no leak between views."""

from __future__ import annotations

import torch

from imgtransfer.network.shortcuts import GRID, PoseCode


def code(views: int = 2) -> PoseCode:
    torch.manual_seed(0)
    return PoseCode(views=views, tokens=6, dim=4)


def images(batch: int = 3, size: tuple[int, int] = (16, 24)) -> torch.Tensor:
    return torch.rand(batch, 2, *size, 3, generator=torch.Generator().manual_seed(1))


def test_it_sees_means_over_fields_channel_by_channel() -> None:
    made, given = code(), images(1)
    inputs: list[torch.Tensor] = []
    made.dense[0].register_forward_hook(lambda _layer, given_to, _result: inputs.append(given_to[0]))
    assert made(given).shape == (1, 2, 6, 4)
    fields = given[0, 1].reshape(GRID, 2, GRID, 3, 3).mean(dim=(1, 3))  # of 2 x 3 pixels each
    torch.testing.assert_close(inputs[0][0, 1], ((fields.movedim(-1, 0) - 0.5) / 0.25).flatten())


def test_what_lies_within_a_field_does_not_matter_and_its_mean_does() -> None:
    made, given = code(), images(1)
    swapped = given.clone()
    swapped[:, :, 0, 0], swapped[:, :, 1, 2] = given[:, :, 1, 2], given[:, :, 0, 0]
    torch.testing.assert_close(made(swapped), made(given))
    swapped[:, :, 0, 0] += 0.5
    assert not torch.allclose(made(swapped), made(given))


def test_each_view_and_frame_is_coded_by_itself() -> None:
    made, given = code(), images()
    changed = given.clone()
    changed[2, 1] = 0
    same = torch.ones(3, 2, dtype=torch.bool)
    same[2, 1] = False
    difference = (made(changed) - made(given)).abs().amax(dim=(-2, -1))
    assert torch.equal(difference < 1e-6, same)


def test_calibrated_images_are_centred_and_of_unit_spread() -> None:
    made, given = code(), images(20) * torch.tensor([0.1, 0.2, 0.3])
    inputs: list[torch.Tensor] = []
    made.dense[0].register_forward_hook(lambda _layer, given_to, _result: inputs.append(given_to[0]))
    made.calibrate(given)
    made(given)
    torch.testing.assert_close(inputs[0].mean(dim=0), torch.zeros(2, 3 * GRID**2), rtol=0, atol=1e-4)
    torch.testing.assert_close(inputs[0].square().mean(), torch.tensor(1.0))


def test_images_that_are_all_alike_divide_by_no_zero() -> None:
    made, given = code(), images(1).expand(4, -1, -1, -1, -1)
    made.calibrate(given)
    assert made.scale > 0
    assert torch.isfinite(made(given)).all()


def test_the_calibration_is_stored_with_the_weights() -> None:
    made, other = code(), code()
    made.calibrate(images())
    other.load_state_dict(made.state_dict())
    torch.testing.assert_close(other(images()), made(images()), rtol=0, atol=0)
