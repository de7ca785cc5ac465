"""The linear basis of a family of shapes, from a stand-in for Anny whose shapes are known."""

import numpy as np
import pytest
import torch

from imgtransfer.bodies.bake import RANK, phenotype_basis
from imgtransfer.bodies.shape import ANCHORS, CORNERS

LABELS = ["weight", "gender", "height", "age", "proportions", "muscle"]  # not in the order of ANCHORS
TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
VERTICES, BONES = 7, 3


class Linear:
    """Rest meshes and bones that go linearly with the parameters, with more bones and vertices than are carried."""

    phenotype_labels = LABELS
    dtype = torch.float64

    def __init__(self):
        random = np.random.default_rng(0)
        self.skin = random.normal(size=(6, VERTICES + 2, 3))
        self.heads = random.normal(size=(6, BONES + 2, 3))

    def __call__(self, *, pose_parameters, phenotype_kwargs):
        assert pose_parameters is None
        poses = torch.zeros(len(phenotype_kwargs), BONES + 2, 4, 4, dtype=torch.float64)
        poses[:, :, :3, 3] = torch.einsum("bp,pkx->bkx", phenotype_kwargs, torch.from_numpy(self.heads))
        vertices = torch.einsum("bp,pvx->bvx", phenotype_kwargs, torch.from_numpy(self.skin))
        return {"rest_vertices": vertices, "rest_bone_poses": poses}


@pytest.fixture(scope="module")
def baked():
    carry = np.random.default_rng(1).dirichlet(np.ones(VERTICES), 5)  # five light vertices
    model = Linear()
    return model, carry, phenotype_basis(model, carry, [4, 0], TO_Y_UP)


def shapes(model, carry):
    """(216, 5 + 2, 3) what the basis must say, by a plain loop over corners and parameters."""
    wanted = np.zeros((len(CORNERS), 7, 3))
    for number, corner in enumerate(CORNERS):
        for name, value in zip(ANCHORS, corner, strict=True):
            of = LABELS.index(name)
            wanted[number, :5] += value * carry @ model.skin[of, :VERTICES]
            wanted[number, 5:] += value * model.heads[of, [4, 0]]
    return wanted @ TO_Y_UP.T


def test_mean_and_components_give_back_every_corner(baked):
    model, carry, basis = baked
    wanted = shapes(model, carry)
    scaled = basis["scales"][:, None, None] * basis["basis"].astype(float)
    given = wanted.mean(axis=0) + np.einsum("cr,rvx->cvx", basis["corners"], scaled)
    np.testing.assert_allclose(given, wanted, atol=0.005)  # half floats of numbers up to about 3


def test_components_are_stored_as_large_as_half_floats_hold_them_best(baked):
    basis = baked[2]["basis"]
    assert basis.dtype == np.float16
    assert basis.shape == (min(RANK, 7 * 3), 7, 3)
    # The largest number of each component is 1, never -1: an SVD leaves the sign open.
    assert np.array_equal(basis.reshape(len(basis), -1).max(axis=1), np.ones(len(basis)))
    assert np.abs(basis).max() == 1


def test_components_come_by_size_and_no_more_count_than_there_are_parameters(baked):
    size = np.linalg.norm(baked[2]["corners"], axis=0)
    assert (np.diff(size) <= 1e-6).all()
    assert (size[:6] > 0.1).all()
    assert size[6:].max() < 1e-5
