"""What a network is shown: metres and normals in images, encoded, and the body by the garment's cameras."""

from __future__ import annotations

import pytest
import torch

from imgtransfer.network.config import NetworkConfig
from imgtransfer.network.maps import BodyImager, ImagePair, metric_maps
from render import InputError, Mesh, PositionBox, TemplateImager, encode_normals
from tests.helpers.example_meshes import sphere, two_triangles

CPU = torch.device("cpu")
BOX = PositionBox((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def imager(mesh: Mesh, size: tuple[int, int] = (12, 10)) -> TemplateImager:
    return TemplateImager.build(mesh, views=("front", "back"), size=size, backend="numpy")


def posed(mesh: Mesh, *shifts: float) -> torch.Tensor:
    """(B, N, 3) the mesh, moved along x."""
    start = torch.from_numpy(mesh.vertices).float()
    return torch.stack([start + torch.tensor([shift, 0, 0]) for shift in shifts])


def test_positions_and_normals_of_a_square_by_hand() -> None:
    square = two_triangles()
    made = imager(square)
    positions, normals = metric_maps(made, posed(square, 0.0, 0.25))
    assert positions.shape == normals.shape == (2, 2, 12, 10, 3)
    front = made.mask[0]
    assert front.any()
    torch.testing.assert_close(
        positions[1, 0][front] - positions[0, 0][front],
        torch.tensor([[0.25, 0, 0]]).expand(int(front.sum()), 3),
    )
    torch.testing.assert_close(positions[0, 0][front][:, 2], torch.zeros(int(front.sum())), rtol=0, atol=1e-6)
    torch.testing.assert_close(normals[0, 0][front], torch.tensor([[0.0, 0, 1]]).expand(int(front.sum()), 3))
    assert positions[:, ~made.mask].abs().max() == 0


def test_encoding_keeps_the_background_zero_and_decodes_to_what_it_was() -> None:
    square = two_triangles()
    made = imager(square)
    positions, normals = metric_maps(made, posed(square, 0.1))
    pair = ImagePair.encode(positions, normals, made.mask, BOX)
    kept = made.mask[None]
    assert pair.positions[~kept].abs().max() == pair.normals[~kept].abs().max() == 0
    assert 0 <= pair.positions.min() <= pair.positions.max() <= 1
    torch.testing.assert_close(
        pair.positions[kept], (positions[kept] + 1) / 2
    )  # a box of 2 m around the origin
    torch.testing.assert_close(pair.normals[kept], encode_normals(normals)[kept])


@pytest.fixture(scope="module")
def garment() -> TemplateImager:
    return imager(sphere(0.35, 16, 9))


def body_imager(garment: TemplateImager, **switches: object) -> BodyImager:
    config = NetworkConfig.model_validate(switches)
    return BodyImager(garment, sphere(0.3, 16, 9), box=BOX, config=config, device=CPU)


def test_the_body_is_seen_by_the_garments_cameras(garment: TemplateImager) -> None:
    made = body_imager(garment)
    shown = made(posed(sphere(0.3, 16, 9), 0.0, 0.2))
    assert shown.guess is None  # absolute values need none
    assert made.mask.shape == garment.mask.shape
    assert not (made.mask & ~garment.mask).any()  # the smaller sphere lies within the larger one's outline
    moved = (shown.images.positions[1] - shown.images.positions[0])[made.mask]
    torch.testing.assert_close(moved, torch.tensor([[0.1, 0, 0]]).expand_as(moved), rtol=0, atol=1e-6)


def test_a_batch_of_bodies_equals_its_singles(garment: TemplateImager) -> None:
    made = body_imager(garment, target="residual")
    bodies = posed(sphere(0.3, 16, 9), 0.0, 0.1, -0.2)
    whole = made(bodies)
    assert whole.guess is not None
    for frame in range(3):
        one = made(bodies[frame : frame + 1])
        assert one.guess is not None
        torch.testing.assert_close(one.images.normals[0], whole.images.normals[frame])
        torch.testing.assert_close(one.guess.positions[0], whole.guess.positions[frame])


@pytest.mark.parametrize("frame", ["canonical", "body"])
def test_the_guess_follows_a_moved_body(garment: TemplateImager, frame: str) -> None:
    guess = body_imager(garment, target="residual", frame=frame)(posed(sphere(0.3, 16, 9), 0.25)).guess
    assert guess is not None
    template, normals = metric_maps(garment, posed(garment.mesh, 0.0))
    wanted = template + torch.tensor([0.25, 0, 0]) * garment.mask[..., None]
    torch.testing.assert_close(guess.positions, wanted, rtol=0, atol=1e-4)
    torch.testing.assert_close(guess.normals, normals, rtol=0, atol=1e-3)


def test_a_body_out_of_every_view_is_refused_in_one_line(garment: TemplateImager) -> None:
    far = sphere(0.3, 16, 9)
    with pytest.raises(InputError) as caught:
        BodyImager(garment, Mesh(far.vertices + 50, far.faces), box=BOX, config=NetworkConfig(), device=CPU)
    assert "\n" not in str(caught.value)
