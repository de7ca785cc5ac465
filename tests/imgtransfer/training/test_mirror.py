"""Mirrored images against a plain loop over their pixels."""

from __future__ import annotations

import pytest
import torch

from imgtransfer.network.base import Guess
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.training.mirror import Mirror
from render import PositionBox, TemplateImager
from tests.helpers.example_meshes import two_triangles

WIDTH = 6


@pytest.fixture(scope="module")
def imager() -> TemplateImager:
    return TemplateImager.build(two_triangles(), size=(4, WIDTH), backend="numpy")


def test_every_pixel_comes_from_the_opposite_column(imager: TemplateImager) -> None:
    # The square lies about x = 0 in a box from -2 to 4: an encoded x of c becomes 2 (0 + 2) / 6 - c.
    box = PositionBox([-2.0, -1, -1], [4.0, 1, 1])
    torch.manual_seed(0)
    mask, body_mask = torch.rand(2, 2, 4, WIDTH) > 0.4
    mirror = Mirror(imager, mask, body_mask, box)
    pair = ImagePair(torch.rand(3, 2, 4, WIDTH, 3), torch.rand(3, 2, 4, WIDTH, 3))
    guess = Guess(*torch.randn(2, 3, 2, 4, WIDTH, 3), torch.randn(3, 2, 4, WIDTH, 3, 3))
    garment, body = mirror.garment(pair), mirror.body(BodyMaps(pair, guess))
    assert body.guess is not None
    assert body.guess.rotation is not None
    assert guess.rotation is not None
    for frame, view, row, column in torch.cartesian_prod(*map(torch.arange, (3, 2, 4, WIDTH))).tolist():
        here, there = (frame, view, row, column), (frame, view, row, WIDTH - 1 - column)
        covered, skin = mask[there[1:]], body_mask[there[1:]]
        assert mirror.mask[here[1:]] == covered
        position, normal = pair.positions[there], pair.normals[there]
        want = torch.tensor([2 * 2 / 6 - position[0], position[1], position[2]])
        torch.testing.assert_close(garment.positions[here], want * covered)
        torch.testing.assert_close(body.images.positions[here], want * skin)
        want = torch.tensor([1 - normal[0], normal[1], normal[2]])
        torch.testing.assert_close(garment.normals[here], want * covered)
        torch.testing.assert_close(body.images.normals[here], want * skin)
        sign = torch.tensor([-1.0, 1, 1])
        torch.testing.assert_close(
            body.guess.positions[here], guess.positions[there] * sign * covered, atol=1e-6, rtol=0
        )
        torch.testing.assert_close(body.guess.normals[here], guess.normals[there] * sign * covered)
        turned = torch.diag(sign) @ guess.rotation[there] @ torch.diag(sign)
        torch.testing.assert_close(body.guess.rotation[here], turned)


def test_mirrored_images_lie_in_memory_as_the_others(imager: TemplateImager) -> None:
    # Convolutions sum in another order over another layout: trainings would differ in their last digits.
    mask = torch.ones(2, 4, WIDTH, dtype=torch.bool)
    mirror = Mirror(imager, mask, mask, PositionBox([-1.0, -1, -1], [1.0, 1, 1]))
    pair = ImagePair(*torch.rand(2, 3, 2, 4, WIDTH, 3))
    assert mirror.garment(pair).positions.stride() == pair.positions.stride()
