"""Mirrored images against a plain loop over their pixels."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, TypeVar

import pytest
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.network.base import Guess
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.mirror import Mirror
from imgtransfer.network.places import PLACES
from render import PositionBox, TemplateImager
from tests.helpers.example_meshes import two_triangles
from tests.helpers.models import model_for

T = TypeVar("T", bound=Any)

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


def random_maps(frames: int, mask: torch.Tensor, body_mask: torch.Tensor) -> tuple[BodyMaps, ImagePair]:
    """Maps of the body and of the garment, 0 off their silhouettes."""
    shape = (frames, *mask.shape, 3)
    on, skin = mask[..., None], body_mask[..., None]
    rotation = torch.randn(*shape, 3) * on[..., None]
    guess = Guess(torch.randn(shape) * on, torch.randn(shape) * on, rotation)
    local = torch.randn(frames, 2, 2, 3, PLACES + 1, 2, 3)
    body = ImagePair(torch.rand(shape) * skin, torch.rand(shape) * skin)
    skinned = ImagePair(torch.rand(shape) * on, torch.rand(shape) * on)
    return BodyMaps(body, guess, local, skinned), ImagePair(torch.rand(shape) * on, torch.rand(shape) * on)


def tensors(maps: BodyMaps | ImagePair) -> list[torch.Tensor]:
    """All tensors of maps, whatever they are made of; what is None is not there."""
    parts = [part for field in fields(maps) if (part := getattr(maps, field.name)) is not None]
    return [one for part in parts for one in ([part] if isinstance(part, torch.Tensor) else tensors(part))]


def test_mirrored_back_everything_is_as_before(imager: TemplateImager) -> None:
    torch.manual_seed(0)
    mask, body_mask = torch.rand(2, 2, 4, WIDTH) > 0.4
    mirror = Mirror(imager, mask, body_mask, PositionBox([-2.0, -1, -1], [4.0, 1, 1]))
    body, garment = random_maps(3, mask, body_mask)
    back = mirror.inverse
    again = [*tensors(back.body(mirror.body(body))), *tensors(back.garment(mirror.garment(garment)))]
    for before, after in zip([*tensors(body), *tensors(garment)], again, strict=True):
        torch.testing.assert_close(after, before, rtol=0, atol=1e-6)
    assert torch.equal(back.mask, mask)


@pytest.mark.parametrize("frames", [[0, 1, 0, 1], [1, 1, 1, 1], [0, 0, 0, 0]])
def test_a_batch_may_mix_mirrored_frames_with_others(imager: TemplateImager, frames: list[int]) -> None:
    torch.manual_seed(0)
    mask, body_mask = torch.rand(2, 2, 4, WIDTH) > 0.4
    mirror = Mirror(imager, mask, body_mask, PositionBox([-2.0, -1, -1], [4.0, 1, 1]))
    body, garment = random_maps(4, mask, body_mask)
    chosen = torch.tensor(frames, dtype=torch.bool)
    mixed = [
        *tensors(mirror.body(body, chosen)),
        *tensors(mirror.garment(garment, chosen)),
        mirror.masks(chosen),
    ]
    plain = [*tensors(body), *tensors(garment), mask.expand(4, -1, -1, -1)]
    flipped = [
        *tensors(mirror.body(body)),
        *tensors(mirror.garment(garment)),
        mirror.mask.expand(4, -1, -1, -1),
    ]
    for found, before, after in zip(mixed, plain, flipped, strict=True):
        for frame, turned in enumerate(frames):
            assert torch.equal(found[frame], (after if turned else before)[frame])


def test_the_average_is_of_positions_and_of_unit_normals(imager: TemplateImager) -> None:
    mask = torch.ones(2, 4, WIDTH, dtype=torch.bool)
    mirror = Mirror(imager, mask, mask, PositionBox([-1.0, -1, -1], [1.0, 1, 1]))
    positions, normals = torch.tensor([0.25, 0.5, 0.75]), torch.tensor([0.0, 0.0, 4.0])
    other_positions, other_normals = torch.tensor([0.25, 0.5, 0.25]), torch.tensor([-1.0, 0.0, 0.0])
    images = ImagePair(*(v.expand(1, 2, 4, WIDTH, 3) for v in (positions, (normals + 1) / 2)))
    mirrored = ImagePair(*(v.expand(1, 2, 4, WIDTH, 3) for v in (other_positions, (other_normals + 1) / 2)))
    found = mirror.average(images, mirrored)
    # Mirrored back, x is 1 - 0.25, and the normal points along +x.
    torch.testing.assert_close(found.positions[0, 0, 1, 2], torch.tensor([0.5, 0.5, 0.5]))
    want = torch.tensor([0.5**0.5, 0.0, 0.5**0.5])
    torch.testing.assert_close(found.normals[0, 1, 2, 3] * 2 - 1, want)


def test_a_symmetric_scene_gives_a_symmetric_prediction(tube_clip: Clip) -> None:
    model = model_for(tube_clip)
    mask, body_mask = (m & m.flip(-1) for m in (model.mask, model.body_imager(tube_clip).mask))
    mirror = Mirror(model.imager, mask, body_mask, model.box)
    torch.manual_seed(0)
    body, garment = random_maps(2, mask, body_mask)
    body = replace(body, garment=None)  # the template is shown
    body, garment = symmetric(body, mirror.body(body)), symmetric(garment, mirror.garment(garment))
    model.garment_positions, model.garment_normals = garment.positions[:1], garment.normals[:1]
    with torch.no_grad():
        versions = model.versions(model.garment(), mirror)
        alone, averaged = model(body), model.averaged(body, mirror, versions)
    kept = mask[..., None]
    for images, tolerance in ((averaged, 1e-5), (alone, None)):
        found = [value * kept for value in (images.positions, images.normals)]
        turned = tensors(mirror.garment(ImagePair(*found)))
        apart = max((a - b).abs().max().item() for a, b in zip(found, turned, strict=True))
        assert apart < tolerance if tolerance else apart > 1e-3  # a network alone is not symmetric


def symmetric(maps: T, mirrored: T) -> T:
    """The mean of maps and their mirror images."""
    if maps is None or isinstance(maps, torch.Tensor):
        return None if maps is None else (maps + mirrored) / 2
    return type(maps)(*(symmetric(getattr(maps, f.name), getattr(mirrored, f.name)) for f in fields(maps)))
