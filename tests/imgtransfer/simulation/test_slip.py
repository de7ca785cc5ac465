"""How far an opening slips over the body: by hand, on a mast with a ring about it."""

import numpy as np
import pytest

from imgtransfer.simulation.config import GateConfig
from imgtransfer.simulation.quality import faults, measure
from imgtransfer.simulation.slip import slip
from render.mesh.mesh import Mesh

AROUND = np.linspace(0, 2 * np.pi, 8, endpoint=False)


def rings(heights, radius):
    """(8 * H, 3) rings of eight points about the y axis."""
    return np.concatenate([
        np.stack([radius * np.cos(AROUND), np.full(8, height), radius * np.sin(AROUND)], axis=1) for height in heights
    ])  # fmt: skip


def tube_faces(count):
    """Of `count` rings, open at both ends."""
    first = np.arange(8)
    pairs = [(first + 8 * row, (first + 1) % 8 + 8 * row) for row in range(count - 1)]
    return np.concatenate([
        np.concatenate([np.stack([a, b + 8, b], 1), np.stack([a, a + 8, b + 8], 1)]) for a, b in pairs
    ])  # fmt: skip


MAST = rings(np.arange(21) * 0.1, 0.1)  # two metres high, a ring every ten centimetres
SLEEVE = Mesh(rings([1.4, 1.6, 1.8], 0.12), tube_faces(3))


def moved(down):
    return SLEEVE.vertices - [0, down, 0]


def test_a_sleeve_that_slides_down_a_mast_has_slipped_as_far_by_hand():
    frames = np.stack([moved(0.0), moved(0.3), moved(0.1)])
    assert slip(SLEEVE, frames, MAST, np.stack([MAST] * 3)) == pytest.approx(0.3)


def test_it_has_not_slipped_where_the_mast_goes_along():
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # upright to lying
    frames, masts = SLEEVE.vertices @ turn.T + [3, 0, 1], MAST @ turn.T + [3, 0, 1]
    assert slip(SLEEVE, frames[None], MAST, masts[None]) == 0


def test_the_topmost_opening_counts_and_the_median_of_its_vertices():
    frames = SLEEVE.vertices.copy()
    frames[:8] -= [0, 0.6, 0]  # the lower opening
    assert slip(SLEEVE, frames[None], MAST, MAST[None]) == 0
    frames[16:19] -= [0, 0.6, 0]  # three of the upper one's eight
    assert slip(SLEEVE, frames[None], MAST, MAST[None]) == 0
    frames[19:21] -= [0, 0.6, 0]  # five
    assert slip(SLEEVE, frames[None], MAST, MAST[None]) == pytest.approx(0.6)


def test_a_closed_surface_has_nothing_that_could_slip():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
    closed = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    assert slip(closed, corners[None] - [0, 9, 0], MAST, MAST[None]) == 0


def test_a_clip_whose_neck_has_slipped_off_fails_its_gate():
    frames, masts, far = np.stack([moved(0.2)] * 2), np.stack([MAST] * 2), np.full((2, 24), 0.02)
    found = measure(SLEEVE, frames, masts, tube_faces(21), rest=MAST, before=far, after=far, fps=30.0)
    assert found.slip == pytest.approx(0.2)
    assert [fault.split()[0] for fault in faults(found, GateConfig())] == ["slip"]
