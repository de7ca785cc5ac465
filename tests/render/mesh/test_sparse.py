import numpy as np
import pytest
import torch

from render.mesh.sparse import SparseProduct, differences


def test_repeated_places_are_summed():
    product = SparseProduct(np.array([0, 0, 1]), np.array([2, 2, 0]), np.array([1.0, 2, 5]), (2, 3))
    dense = torch.tensor([[1.0], [10], [100]], dtype=torch.float64)
    assert product(dense).tolist() == [[300], [5]]
    assert product.transposed(torch.tensor([[1.0], [10]], dtype=torch.float64)).tolist() == [[50], [0], [3]]


def test_a_matrix_without_entries_gives_zeros():
    none = np.zeros(0, np.int64)
    product = SparseProduct(none, none, np.zeros(0), (4, 3))
    assert torch.equal(product(torch.ones(2, 3, 5)), torch.zeros(2, 4, 5))
    assert torch.equal(product.transposed(torch.ones(4, 5)), torch.zeros(3, 5))


def test_differences_by_hand():
    values = torch.tensor([[1.0, 5], [4, 7], [9, 2]])
    assert differences(np.array([[0, 1], [2, 0], [1, 1]]), 3)(values).tolist() == [[-3, -2], [8, -3], [0, 0]]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("frames", [1, 3])
def test_columns_without_entries_are_passed_over_and_may_hold_anything(dtype, frames):
    """Columns 2, 5 and 6 of nine have entries; the others hold what no sum survives."""
    product = SparseProduct(np.array([0, 0, 1, 3]), np.array([6, 2, 5, 2]), np.array([1.0, 2, 3, 4]), (4, 9))
    dense = torch.full((frames, 9, 2), torch.nan, dtype=dtype)
    dense[:, [2, 5, 6]] = torch.tensor([[1.0, 10], [2, 20], [3, 30]], dtype=dtype)
    want = torch.tensor([[5.0, 50], [6, 60], [0, 0], [4, 40]], dtype=dtype)
    assert torch.equal(product(dense), want.expand(frames, 4, 2))
    clean = dense.nan_to_num().requires_grad_()
    product(clean)[..., 0].sum().backward()
    assert clean.grad is not None
    assert clean.grad[0, :, 0].tolist() == [0, 0, 6, 0, 0, 3, 1, 0, 0]
