"""Systems that are factorised once and solved for any number of frames."""

import numpy as np
import pytest
import scipy.sparse
import torch

from render.mesh.factor import Factor

CPU = torch.device("cpu")
# A chain of three springs, its first end held: by hand, the inverse of the matrix below.
CHAIN = scipy.sparse.csr_matrix([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
INVERSE = torch.tensor([[1.0, 1, 1], [1, 2, 2], [1, 2, 3]])


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-6), (torch.float64, 1e-14)])
@pytest.mark.parametrize("layout", ["csr", "csc", "coo"])
def test_a_chain_of_springs_by_hand(dtype, tolerance, layout):
    factor = Factor(CHAIN.asformat(layout), CPU, dtype)
    right = torch.eye(3, dtype=dtype)[None]  # axis k pulls at vertex k
    found = factor.solve(right)
    assert found.dtype == dtype
    torch.testing.assert_close(found[0], INVERSE.to(dtype), rtol=0, atol=tolerance)


@pytest.mark.parametrize("frames", [1, 41, 42, 43, 85])
def test_any_number_of_frames_is_solved_each_by_itself(frames):
    """42 frames are as many columns as are taken at once."""
    factor = Factor(CHAIN, CPU, torch.float64)
    right = torch.arange(9.0 * frames, dtype=torch.float64).reshape(frames, 3, 3)
    kept = right.clone()
    found = factor.solve(right)
    torch.testing.assert_close(found, INVERSE.double() @ right, rtol=1e-12, atol=0)
    assert torch.equal(right, kept)
    assert found.is_contiguous()


def test_no_frames_are_solved_too():
    """The library ended the process without a word."""
    factor = Factor(CHAIN, CPU, torch.float64)
    assert factor.solve(torch.zeros(0, 3, 3, dtype=torch.float64)).shape == (0, 3, 3)


@pytest.mark.parametrize("count", [2, 4])
def test_another_number_of_vertices_is_refused(count):
    """The library reads and writes as many as it knows, beyond the end of what it is given."""
    with pytest.raises(ValueError, match=f"of 3 vertices solves for as many, found {count}"):
        Factor(CHAIN, CPU, torch.float64).solve(torch.zeros(1, count, 3, dtype=torch.float64))


def test_frames_that_lie_otherwise_in_memory_are_read_right():
    factor = Factor(CHAIN, CPU, torch.float64)
    right = torch.randn(3, 3, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64).permute(
        2, 1, 0
    )
    torch.testing.assert_close(factor.solve(right), INVERSE.double() @ right)


def test_numbering_the_vertices_otherwise_gives_the_same():
    order = np.array([2, 0, 1])
    right = torch.randn(2, 3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    want = Factor(CHAIN, CPU, torch.float64).solve(right)[:, order]
    found = Factor(CHAIN[order][:, order], CPU, torch.float64).solve(right[:, order])
    torch.testing.assert_close(found, want)


def test_a_system_that_holds_nothing_is_refused():
    """A chain that no end holds may move as a whole; of opposite sign it is no minimum."""
    for matrix in (CHAIN - scipy.sparse.diags([1.0, 0, 0]) * 2, -CHAIN):
        with pytest.raises(ValueError, match="not positive definite"):
            Factor(matrix.tocsr(), CPU, torch.float64)
