import numpy as np
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
