import numpy as np
import pytest
import torch

from render import InputError, PositionBox, decode_normals, encode_normals


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor], ids=["numpy", "torch"])
def test_box_by_hand(kind):
    box = PositionBox([-1, 0, 2], [1, 4, 3])
    points = kind(np.array([[-1.0, 0, 2], [1, 4, 3], [0, 1, 2.5], [2, -4, 2]]))
    expected = np.array([[0, 0, 0], [1, 1, 1], [0.5, 0.25, 0.5], [1.5, -1, 0]])  # not clipped outside
    np.testing.assert_allclose(np.asarray(box.encode(points)), expected)
    np.testing.assert_allclose(np.asarray(box.decode(box.encode(points))), np.asarray(points))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_kept(dtype):
    box = PositionBox([-1, -1, -1], [1, 1, 1])
    points = torch.zeros(2, 5, 3, dtype=dtype)
    assert box.encode(points).dtype == dtype
    assert box.decode(points.numpy()).dtype == points.numpy().dtype
    assert encode_normals(points).dtype == dtype


def test_box_around_points():
    box = PositionBox.around(np.array([[[0.0, 0, 0], [2, 1, 0]]]), margin=0.1)
    np.testing.assert_allclose(box.lo, [-0.2, -0.1, -0.001])
    np.testing.assert_allclose(box.hi, [2.2, 1.1, 0.001])


@pytest.mark.parametrize(
    ("lo", "hi"),
    [([0, 0, 0], [1, 0, 1]), ([0, 0, 0], [1, -1, 1]), ([0, 0], [1, 1]), ([0, 0, np.nan], [1, 1, 1])],
)
def test_unusable_boxes_are_refused(lo, hi):
    with pytest.raises(InputError, match="position box"):
        PositionBox(lo, hi)


def test_a_box_around_broken_points_is_refused():
    for points in (np.zeros((0, 3)), np.array([[np.inf, 0, 0]])):
        with pytest.raises(InputError, match="finite points"):
            PositionBox.around(points)


def test_normals_by_hand():
    normals = torch.tensor([[0.0, 0, 1], [-1, 0, 0]])
    colours = encode_normals(normals)
    assert colours.tolist() == [[0.5, 0.5, 1.0], [0.0, 0.5, 0.5]]
    assert torch.equal(decode_normals(colours), normals)
