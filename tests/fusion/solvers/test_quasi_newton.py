"""Descent on energies whose minimum is known: the displacement term, a bowl around the anchor with one curvature."""

import numpy as np
import pytest
import scipy.sparse
import torch

from fusion import Topology
from fusion.solvers.contact import Contact
from fusion.solvers.energy import Energy
from fusion.solvers.quasi_newton import descend
from fusion.solvers.system import System
from tests.helpers.example_meshes import two_triangles
from tests.helpers.half_space import HalfSpace

SQUARE = Topology(two_triangles())
REST = torch.from_numpy(SQUARE.rest_vertices)
WEIGHT = 3.0


def bowl(anchor, **weights):
    """3 · mean |x - anchor|², whose Hessian is 2 · 3 / 4 at each vertex."""
    return Energy(SQUARE, {"displacement_m2": WEIGHT} | weights, anchor, torch.full((1, 4), 0.25).double())


def diagonal(value):
    return System(scipy.sparse.eye(4) * value, torch.device("cpu"), torch.float64)


EXACT = 2 * WEIGHT / 4


def anchors(frames=2):
    return REST + torch.randn(frames, 4, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def test_with_the_exact_hessian_one_step_reaches_the_minimum():
    anchor = anchors()
    found = descend(bowl(anchor), diagonal(EXACT), REST.expand(2, -1, -1), steps=1, tolerance=0.0)
    torch.testing.assert_close(found.vertices, anchor)
    assert found.iterations.tolist() == [1, 1]
    assert found.depths is None
    assert found.history.shape == (2, 2, 4)
    want = (REST - anchor).square().sum((-2, -1)) / 4
    torch.testing.assert_close(found.history[:, :, 1], torch.stack([want, torch.zeros(2).double()]))


def test_a_step_that_is_too_long_is_halved_until_it_descends():
    """An eighth of the curvature leads eight times as far; 8, 4, 2 rise or do not fall enough, 1 is the minimum."""
    anchor = anchors()
    found = descend(bowl(anchor), diagonal(EXACT / 8), REST.expand(2, -1, -1), steps=1, tolerance=0.0)
    torch.testing.assert_close(found.vertices, anchor)


def test_the_second_step_knows_the_curvature_that_the_first_one_met():
    """The system is ten times too stiff: the first step goes a tenth of the way, the next one all of the rest."""
    anchor = anchors()
    run = [
        descend(bowl(anchor), diagonal(10 * EXACT), REST.expand(2, -1, -1), steps=steps, tolerance=0.0)
        for steps in (1, 2)
    ]
    torch.testing.assert_close(run[0].vertices, REST + 0.1 * (anchor - REST))
    torch.testing.assert_close(run[1].vertices, anchor)


def test_a_start_at_the_minimum_is_left_as_it_is():
    anchor = anchors()
    found = descend(bowl(anchor), diagonal(EXACT), anchor, steps=5, tolerance=0.0)
    assert torch.equal(found.vertices, anchor)
    assert found.history[..., 1].eq(0).all()


@pytest.mark.parametrize("steps", [0, 3])
def test_what_is_pinned_stays_to_the_bit_and_the_rest_goes_where_it_wants(steps):
    anchor, loose = anchors(), torch.tensor([True, False, True, False])
    start = REST.expand(2, -1, -1).clone()
    found = descend(bowl(anchor), diagonal(EXACT), start, steps=steps, tolerance=0.0, loose=loose)
    assert torch.equal(found.vertices[:, ~loose], start[:, ~loose])
    torch.testing.assert_close(found.vertices[:, loose], (anchor if steps else start)[:, loose])


def test_vertices_whose_anchors_are_in_the_ground_end_above_it_next_to_them():
    """The least of the bowl outside of y < 0: the anchor's foot on the ground."""
    anchor = torch.tensor([[[0.0, -0.5, 0], [1, 0.5, 0], [2, -3, 1], [0, 0, 2]]], dtype=torch.float64)
    start = anchor + torch.tensor([0.3, 4.0, -0.2]).double()
    contact = Contact(HalfSpace(), anchor, margin_m=0.1, every_steps=2)
    found = descend(bowl(anchor), diagonal(EXACT), start, steps=6, tolerance=0.0, contact=contact)
    want = anchor.clone()
    want[..., 1] = want[..., 1].clamp(min=0.1)
    torch.testing.assert_close(found.vertices, want)
    assert found.depths[0].item() == pytest.approx(0)
    assert found.depths[-1].item() == pytest.approx(0, abs=1e-12)


def test_a_start_in_the_ground_is_lifted_before_the_first_step_and_its_depth_told():
    start = REST[None] - torch.tensor([0, 2.0, 0]).double()  # heights -2.5, -2.5, -1.5, -1.5
    contact = Contact(HalfSpace(), start, margin_m=0.0, every_steps=5)
    found = descend(bowl(start), diagonal(EXACT), start, steps=0, tolerance=0.0, contact=contact)
    np.testing.assert_allclose(found.vertices[..., 1], 0, atol=1e-15)
    # One entry: without a step the depth told is that at the end.
    np.testing.assert_allclose(found.depths, [[0.0]], atol=1e-15)


def test_a_frame_is_finished_by_itself_when_its_energy_falls_too_little():
    """Frame 0 begins where it ends; the system is 100 times too stiff, so that frame 1 goes on."""
    anchor = anchors()
    start = torch.stack([anchor[0] + 1e-9, REST])
    energy = Energy(
        SQUARE, {"displacement_m2": WEIGHT, "edge_length_m2": 50.0}, anchor, torch.full((1, 4), 0.25).double()
    )
    factor = diagonal(100.0)
    found = descend(energy, factor, start, steps=20, tolerance=0.02)
    curve = (found.history * energy.factors).sum(-1)
    assert (curve.diff(dim=0) <= 1e-12).all()
    for frame in range(2):
        single = Energy(
            SQUARE,
            {"displacement_m2": WEIGHT, "edge_length_m2": 50.0},
            anchor[[frame]],
            torch.full((1, 4), 0.25).double(),
        )
        alone = descend(single, factor, start[[frame]], steps=20, tolerance=0.02)
        torch.testing.assert_close(found.vertices[frame], alone.vertices[0])
        assert found.iterations[frame] == alone.iterations[0]
    assert found.iterations[0] != found.iterations[1]


def test_the_start_is_not_changed():
    start = REST.expand(2, -1, -1).clone()
    kept = start.clone()
    descend(bowl(anchors()), diagonal(EXACT), start, steps=2, tolerance=0.0)
    assert torch.equal(start, kept)
