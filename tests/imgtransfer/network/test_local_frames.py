"""How a surface has turned, read off its images: on a flat patch whose motion is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from imgtransfer.network.local_frames import LocalFrames, chosen, nearest_rotation, window

SIZE = (12, 16)  # not square: a swap of height and width fails


def turn(*vector: float) -> Tensor:
    return torch.from_numpy(Rotation.from_rotvec(vector).as_matrix()).float()


def relief() -> tuple[Tensor, Tensor, Tensor]:
    """Mask (1, H, W), positions and normals (1, H, W, 3) of a wavy cloth that leaves a border of one pixel."""
    y, x = torch.meshgrid(
        torch.linspace(0.3, -0.3, SIZE[0]), torch.linspace(-0.4, 0.4, SIZE[1]), indexing="ij"
    )
    points = torch.stack([x, y, 0.05 * torch.sin(8 * x)], dim=-1)
    normals = torch.stack([-0.4 * torch.cos(8 * x), torch.zeros_like(x), torch.ones_like(x)], dim=-1)
    mask = torch.zeros(SIZE, dtype=torch.bool)
    mask[1:-1, 1:-1] = True
    kept = mask[..., None]
    return mask[None], (points * kept)[None], (torch.nn.functional.normalize(normals, dim=-1) * kept)[None]


def frames(shapes: int = 1) -> tuple[LocalFrames, Tensor, Tensor]:
    """The fit, and the rest body's images in `shapes` shapes, each 20 % larger than the one before."""
    mask, points, normals = relief()
    rests = torch.stack([points * 1.2**number for number in range(shapes)])
    return LocalFrames(mask, points, rests, normals.expand(shapes, *normals.shape)), rests, normals


def test_a_body_at_rest_has_not_turned() -> None:
    fit, rests, normals = frames()
    rotations = fit(rests, normals[None])
    assert rotations.shape == (1, 1, *SIZE, 3, 3)
    torch.testing.assert_close(rotations, torch.eye(3).expand_as(rotations), rtol=0, atol=1e-5)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 1.0), (0.7, -1.2, 0.4), (0.0, 3.1, 0.0)])
def test_a_rigid_motion_is_found_everywhere_in_the_image_wherever_it_leads(vector: tuple[float, ...]) -> None:
    fit, rests, normals = frames()
    rotation = turn(*vector)
    mask = relief()[0][..., None]
    moved = (rests @ rotation.T + torch.tensor([3.0, -1.0, 2.0])) * mask
    found = fit(moved, (normals @ rotation.T)[None])
    torch.testing.assert_close(found, rotation.expand_as(found), rtol=0, atol=1e-4)  # off the body, too


def test_a_stretched_body_has_not_turned() -> None:
    fit, rests, normals = frames()
    found = fit(1.3 * rests, normals[None])
    torch.testing.assert_close(found, torch.eye(3).expand_as(found), rtol=0, atol=1e-5)


def test_two_halves_that_turn_apart_keep_their_own_rotations() -> None:
    fit, rests, normals = frames()
    turns = (turn(0, 0, 0.3), turn(0, 0, -0.3))
    right = (rests[0, ..., :1] > 0).expand_as(rests[0])
    positions = torch.where(right, rests[0] @ turns[1].T, rests[0] @ turns[0].T)[None]
    turned = torch.where(right, normals @ turns[1].T, normals @ turns[0].T)[None]
    found = fit(positions, turned)[0, 0]
    torch.testing.assert_close(
        found[6, 1], turns[0], rtol=0, atol=0.02
    )  # 0.35 m from the seam, six patches' widths
    torch.testing.assert_close(found[6, -2], turns[1], rtol=0, atol=0.02)


def test_a_batch_of_shapes_equals_its_singles() -> None:
    fit, rests, normals = frames(shapes=2)
    random = torch.Generator().manual_seed(0)
    positions = rests[0] + 0.05 * torch.randn(3, 1, *SIZE, 3, generator=random)
    turned = torch.nn.functional.normalize(
        normals + 0.2 * torch.randn(3, 1, *SIZE, 3, generator=random), dim=-1
    )
    shapes = torch.tensor([1, 0, 1])
    whole = fit(positions, turned, shapes)
    for frame in range(3):
        one = slice(frame, frame + 1)
        torch.testing.assert_close(
            fit(positions[one], turned[one], shapes[one]), whole[one], rtol=0, atol=1e-5
        )
    first = fit(positions[1:2], turned[1:2])
    torch.testing.assert_close(first, whole[1:2], rtol=0, atol=1e-5)  # without a shape it is the first


def test_a_body_of_one_pixel_turns_with_its_normal_alone() -> None:
    mask = torch.zeros(1, 4, 4, dtype=torch.bool)
    mask[0, 1, 2] = True
    points, normals = torch.zeros(1, 1, 4, 4, 3), torch.zeros(1, 1, 4, 4, 3)
    points[..., 1, 2, :], normals[..., 1, 2, :] = torch.tensor([0.1, 0.2, 0.3]), torch.tensor([0.0, 0, 1])
    found = LocalFrames(mask, points[0], points, normals)(points, normals)
    # One direction decides no rotation: none is made up, and nothing is divided by 0.
    torch.testing.assert_close(found, torch.eye(3).expand_as(found))


def test_a_table_of_shapes_is_looked_up() -> None:
    table = torch.arange(6.0).reshape(3, 2)
    assert chosen(table, torch.tensor([2, 0])).tolist() == [[4, 5], [0, 1]]
    assert chosen(table, None).tolist() == [[0, 1]]
    assert chosen(table[:1], torch.tensor([0, 0, 0])).shape == (1, 2)  # broadcasts over the batch


def test_the_nearest_rotation_of_several_scales_at_once() -> None:
    stretch = torch.tensor([[1.0, 0.2, 0], [0.2, 0.8, 0.1], [0, 0.1, 1.3]])
    rotation = turn(0.4, -0.9, 0.2)
    matrices = torch.stack([scale * rotation @ stretch for scale in (1e-6, 1.0, 1e6)])
    torch.testing.assert_close(nearest_rotation(matrices), rotation.expand(3, 3, 3), rtol=0, atol=1e-5)
    assert torch.equal(nearest_rotation(torch.zeros(2, 3, 3)), torch.eye(3).expand(2, 3, 3))


@pytest.mark.parametrize(
    ("dtype", "bound", "rounding"), [(torch.float32, 2e-3, 1e-6), (torch.float64, 1e-11, 1e-14)]
)
def test_a_nearly_flat_patch_has_a_rotation_too(dtype: torch.dtype, bound: float, rounding: float) -> None:
    # A dress's residuals were turned into kilometres by such a patch, which half precision holds as infinite.
    one, other = (
        torch.from_numpy(Rotation.from_rotvec(v).as_matrix()) for v in ((0.4, -0.9, 0.2), (-1.1, 0.3, 2))
    )
    stretch = torch.tensor([[1.2, 1e-3, 1.2], [1.2, 8e-5, 1.2]], dtype=torch.float64)
    found = nearest_rotation((one @ stretch.diag_embed() @ other.mT).to(dtype))
    torch.testing.assert_close(found.double(), (one @ other.mT).expand(2, 3, 3), rtol=0, atol=bound)
    identity = torch.eye(3, dtype=dtype).expand(2, 3, 3)
    torch.testing.assert_close(found @ found.mT, identity, rtol=0, atol=rounding)


def test_the_gradient_of_the_nearest_rotation_is_that_of_differences() -> None:
    random = torch.Generator().manual_seed(1)
    matrices = torch.eye(3, dtype=torch.float64) + 0.2 * torch.randn(
        2, 3, 3, generator=random, dtype=torch.float64
    )
    assert torch.autograd.gradcheck(nearest_rotation, (matrices.requires_grad_(True),))


def test_a_window_by_hand_stops_at_the_border() -> None:
    rows, columns, squared = window(
        np.array([5, 0]), np.array([7, 9]), reach=np.array([4.0, 1.0]), samples=3, size=(8, 10)
    )
    assert rows.tolist() == [[1, 1, 1, 5, 5, 5, 7, 7, 7], [0, 0, 0, 0, 0, 0, 1, 1, 1]]
    assert columns.tolist() == [[3, 7, 9] * 3, [8, 9, 9] * 3]
    assert squared.tolist() == [[1, 1], [1, 0], [1, 1], [0, 1], [0, 0], [0, 1], [1, 1], [1, 0], [1, 1]]


def test_bodies_of_one_shape_turn_as_if_each_had_a_shape_of_its_own() -> None:
    """That they are fitted in one product changes nothing but rounding."""
    one, rests, normals = frames()
    mask, points, _ = relief()
    same = LocalFrames(mask, points, rests.expand(2, *rests.shape[1:]), normals.expand(2, *normals.shape))
    generator = torch.Generator().manual_seed(1)
    posed = rests @ turn(0.2, 0.4, -0.3).T + 0.02 * torch.randn(3, *points.shape, generator=generator)
    turned = (normals @ turn(0.2, 0.4, -0.3).T).expand(3, *normals.shape)
    several = same(posed, turned, torch.tensor([0, 1, 0]))
    torch.testing.assert_close(one(posed, turned), several, rtol=0, atol=1e-5)
