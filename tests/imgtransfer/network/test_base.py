"""The first guess from the body's images, and the frames that turn with the surface."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.network.base import BodyGuess
from imgtransfer.network.local_frames import nearest_rotation
from imgtransfer.network.maps import BodyImager
from render import InputError, Mesh, PositionBox

NETWORK = {"encoder": {"patch": 16, "dim": 16, "depth": 1, "heads": 1}, "blocks": 1, "target": "residual"}


def body_imager(clip: Clip, frame: str) -> tuple[TransferModel, BodyImager]:
    model = TransferModel(
        maps=MapsConfig(size=(64, 48)),
        network=NetworkConfig.model_validate(NETWORK | {"frame": frame}),
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=PositionBox.around(clip.template.vertices, margin=0.5),
    )
    return model, model.body_imager(clip)


@pytest.mark.parametrize("frame", ["canonical", "body"])
def test_the_guess_for_the_rest_body_is_the_template(tube_clip: Clip, frame: str) -> None:
    model, imager = body_imager(tube_clip, frame)
    guess = imager(torch.from_numpy(tube_clip.body.rest)[None]).guess
    assert guess is not None
    template = model.box.decode(model.garment_positions) * model.mask[..., None]
    normals = (model.garment_normals * 2 - 1) * model.mask[..., None]
    torch.testing.assert_close(guess.positions, template, rtol=0, atol=1e-5)
    torch.testing.assert_close(guess.normals, normals, rtol=0, atol=1e-4)
    assert guess.positions[:, ~model.mask].abs().max() == 0


def test_in_the_bodys_frames_the_guess_follows_a_rigid_motion(tube_clip: Clip) -> None:
    model, imager = body_imager(tube_clip, "body")
    turn = Rotation.from_rotvec([0.5, -0.9, 0.7]).as_matrix().astype(np.float32)
    shift = np.float32([0.2, -0.1, 0.4])
    moved = imager(torch.from_numpy(tube_clip.body.rest @ turn.T + shift)[None]).guess
    assert moved is not None
    assert moved.rotation is not None
    template = model.box.decode(model.garment_positions)[:, model.mask]
    normals = model.garment_normals[:, model.mask] * 2 - 1
    turned = torch.from_numpy(turn)
    expected = template @ turned.T + torch.from_numpy(shift)
    torch.testing.assert_close(moved.positions[:, model.mask], expected, rtol=0, atol=1e-5)
    torch.testing.assert_close(moved.normals[:, model.mask], normals @ turned.T, rtol=0, atol=1e-4)
    torch.testing.assert_close(moved.rotation[0, 0, 5, 7], turned, rtol=0, atol=1e-4)
    residual = torch.zeros(1, 2, 64, 48, 3)
    residual[..., 1] = 1.0  # a residual along the rest pose's up turns with the body
    torch.testing.assert_close(moved.turn(residual)[0, 0, 5, 7], turned[:, 1], rtol=0, atol=1e-4)


@pytest.mark.parametrize("frame", ["canonical", "body"])
def test_a_batch_of_guesses_equals_its_frames(tube_clip: Clip, frame: str) -> None:
    _, imager = body_imager(tube_clip, frame)
    vertices = torch.from_numpy(tube_clip.body.vertices)
    together = imager(vertices).guess
    assert together is not None
    for index, frame_vertices in enumerate(vertices):
        single = imager(frame_vertices[None]).guess
        assert single is not None
        torch.testing.assert_close(together.positions[index], single.positions[0], rtol=0, atol=1e-6)


def stripe_guess(body_columns: slice) -> BodyGuess:
    """A garment over 8 x 8 pixels in one view, a body over some of its columns; positions are pixel coordinates."""
    rows, columns = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
    positions = torch.stack([columns, -rows, torch.zeros(8, 8)], dim=-1)[None, None]
    normals = torch.tensor([0.0, 0.0, 1.0]).expand(1, 1, 8, 8, 3)
    body_mask = torch.zeros(1, 8, 8, dtype=torch.bool)
    body_mask[:, :, body_columns] = True
    return BodyGuess(
        mask=torch.ones(1, 8, 8, dtype=torch.bool),
        template_positions=positions,
        template_normals=normals,
        body_mask=body_mask,
        projected=positions[0] * body_mask[..., None],
        rest_positions=positions * body_mask[..., None],
        rest_normals=normals * body_mask[..., None],
        frame="canonical",
    )


def test_the_extension_keeps_the_body_and_reaches_every_pixel() -> None:
    guess = stripe_guess(slice(2, 5))
    body = torch.zeros(1, 8, 8, 1)
    body[:, :, 2:5, 0] = torch.tensor([3.0, 5.0, 7.0])
    extended = guess.extend(body)[0, ..., 0]
    assert torch.equal(extended[:, 2:5], body[0, :, 2:5, 0])
    torch.testing.assert_close(extended[:, :2], torch.full((8, 2), 3.0))  # the nearest column's value
    torch.testing.assert_close(extended[:, 5:], torch.full((8, 3), 7.0))


def test_a_body_out_of_view_is_refused() -> None:
    with pytest.raises(InputError, match="the body covers no pixel of view 0"):
        stripe_guess(slice(0, 0))


def test_nearest_rotation_of_a_stretched_rotation() -> None:
    turn = torch.from_numpy(Rotation.random(20, random_state=0).as_matrix())
    stretch = torch.diag(torch.tensor([0.2, 1.0, 3.0], dtype=torch.float64))
    torch.testing.assert_close(nearest_rotation(turn @ stretch), turn, rtol=0, atol=1e-6)


def test_nearest_rotation_equals_kabsch() -> None:
    torch.manual_seed(0)
    matrices = torch.eye(3, dtype=torch.float64) + 0.3 * torch.randn(50, 3, 3, dtype=torch.float64)
    matrices = matrices[torch.linalg.det(matrices) > 0.2]
    u, _, vt = torch.linalg.svd(matrices)
    torch.testing.assert_close(nearest_rotation(matrices), u @ vt, rtol=0, atol=1e-6)


@pytest.mark.parametrize("matrix", [torch.zeros(3, 3), torch.diag(torch.tensor([1.0, 1.0, -1.0]))])
def test_nearest_rotation_of_a_line_or_a_reflection_is_the_identity(matrix: torch.Tensor) -> None:
    assert torch.equal(nearest_rotation(matrix), torch.eye(3))
