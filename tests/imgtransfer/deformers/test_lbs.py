"""Skinning by hand: a bar of two bones, weights of near vertices, and what diffusion may do to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.lbs import Lbs, LbsConfig
from imgtransfer.deformers.lbs.skinned import turns
from imgtransfer.deformers.lbs.weights import diffused, nearest_weights
from render import InputError
from tests.helpers.clips import with_arrays
from tests.helpers.synthetic import tube

BAR = np.float32([[0, 0, 0], [0, 0.25, 0], [0, 0.75, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [1, 2, 3]])


def bar(degrees: float) -> Clip:
    """A bar along y; its upper half turns about z at (0, 0.5, 0), and all of it moves by 1 m along x."""
    weights = np.float32([[1, 0], [1, 0], [0, 1], [0, 1]])
    poses = np.zeros((1, 2, 3), np.float32)
    poses[0, 1, 2] = np.radians(degrees)
    skeleton = Skeleton(
        poses=poses,
        trans=np.float32([[1, 0, 0]]),
        joints_rest=np.float32([[0, 0, 0], [0, 0.5, 0]]),
        parents=np.array([-1, 0]),
        blend_weights=weights,
    )
    template = Template(BAR + np.float32([0, 0, 0.01]), FACES)
    moves = BAR[None].copy()
    return Clip(template, Garment(moves), Body(BAR, FACES, moves), 30.0, skeleton, name="bar")


def test_a_bar_of_two_bones_bends_at_its_joint(tmp_path: Path) -> None:
    method = Lbs(LbsConfig(neighbours=1, diffusion=0))
    method.fit([bar(0)], FitFolder(tmp_path))
    wanted = [[1, 0, 0.01], [1, 0.25, 0.01], [0.75, 0.5, 0.01], [0.5, 0.5, 0.01]]
    np.testing.assert_allclose(method.predict(bar(90))[0], wanted, atol=1e-6)


def test_weights_are_means_by_the_inverse_of_the_distance() -> None:
    body, weights = np.array([[0.0, 0, 0], [4, 0, 0], [9, 0, 0]]), np.array([[1.0, 0], [0, 1], [0, 1]])
    points = np.array([[1.0, 0, 0], [4, 0, 0]])
    taken = nearest_weights(points, body, weights, 2)
    np.testing.assert_allclose(taken, [[0.75, 0.25], [0, 1]], atol=1e-6)
    np.testing.assert_array_equal(nearest_weights(points, body, weights, 1), [[1, 0], [0, 1]])
    assert nearest_weights(points, body, weights, 50).shape == (2, 2)


def test_diffusion_keeps_sums_and_range_and_spreads_to_the_mean() -> None:
    vertices, faces = tube(0.2, 0.6, 12, 16, closed=False)
    weights = np.random.default_rng(0).dirichlet(np.ones(3), len(vertices))
    little, much = (diffused(weights, vertices.astype(float), faces, length) for length in (0.02, 50.0))
    for spread in (little, much):
        np.testing.assert_allclose(spread.sum(1), 1, atol=1e-9)
        assert spread.min() >= 0
    assert np.ptp(much, axis=0).max() < 1e-3 < np.ptp(little, axis=0).min() < np.ptp(weights, axis=0).min()


def test_a_vertex_of_no_face_keeps_its_weights() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    values = np.array([[1.0], [0], [0], [0.3]])
    assert diffused(values, vertices, np.array([[0, 1, 2]]), 0.5)[3] == pytest.approx(0.3)


def test_a_mean_of_opposite_turns_is_still_a_rotation() -> None:
    half_turns = np.stack([np.diag([1.0, 1, 1]), np.diag([-1.0, -1, 1]), np.diag([-1.0, 1, -1])])
    blended = np.concatenate([np.einsum("k,kab->ab", w, half_turns)[None] for w in np.full((1, 3), 1 / 3)])
    nearest = turns(np.concatenate([blended, np.zeros((1, 3, 1))], axis=-1)[None])[0, 0]
    np.testing.assert_allclose(nearest @ nearest.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(nearest) == pytest.approx(1)


@pytest.mark.parametrize(
    ("without", "message"),
    [("blend_weights", "lacks blend_weights"), ("garment_vertices", "has no garment_vertices")],
)
def test_what_fitting_lacks_is_said_in_one_line(without: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        Lbs(LbsConfig()).fit([with_arrays(bar(0), **{without: None})], FitFolder(tmp_path))


def test_a_clip_to_predict_needs_no_garment_but_a_skeleton(tmp_path: Path) -> None:
    method = Lbs(LbsConfig())
    method.fit([bar(0)], FitFolder(tmp_path))
    np.testing.assert_array_equal(
        method.predict(with_arrays(bar(9), garment_vertices=None)), method.predict(bar(9))
    )
    with pytest.raises(InputError, match="no skinning"):
        method.predict(with_arrays(bar(0), poses=None))


def test_another_garment_or_skeleton_is_refused(tmp_path: Path) -> None:
    method = Lbs(LbsConfig())
    method.fit([bar(0)], FitFolder(tmp_path))
    with pytest.raises(InputError, match="another garment"):
        method.predict(with_arrays(bar(0), garment_faces=FACES[:, [0, 2, 1]]))
    one = {"poses": np.zeros((1, 1, 3)), "joints_rest": np.zeros((1, 3)), "parents": np.array([-1])}
    with pytest.raises(InputError, match=r"1 columns.*with 2"):
        method.predict(with_arrays(bar(0), blend_weights=np.ones((4, 1)), **one))
