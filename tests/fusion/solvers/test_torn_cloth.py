"""Which vertices a lift would tear away from the cloth around them, by hand."""

import numpy as np
import pytest
import torch

from fusion import Topology
from fusion.obstacles.sdf import SdfQuery
from fusion.solvers.contact import Contact
from fusion.solvers.torn_cloth import torn_away
from render import Mesh
from tests.helpers.half_space import HalfSpace

# A strip of two faces: edges are 0, 1 and 0, 2 and 1, 2 and 1, 3 and 2, 3, as long as 10 or 14 cm.
STRIP = Topology(
    Mesh(np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0.1], [0.1, 0, 0.1]]), np.array([[0, 2, 1], [1, 2, 3]]))
)
FLAT = torch.from_numpy(STRIP.rest_vertices)[None]


def lifted(*heights):
    lift = torch.zeros_like(FLAT)
    lift[0, :, 1] = torch.tensor(heights)
    return lift


@pytest.mark.parametrize(
    ("heights", "torn"),
    [
        ((0.05, 0.05, 0.05, 0.05), [False] * 4),  # all go together
        ((0.2, -0.03, -0.03, -0.03), [True, False, False, False]),  # against its neighbours
        ((0.03, -0.2, 0.03, -0.2), [False, True, False, True]),
        ((0.01, -0.01, 0.01, -0.01), [False] * 4),  # not deep
    ],
)
def test_of_a_torn_edge_the_end_that_goes_farther_is_torn_away(heights, torn):
    assert torn_away(FLAT, lifted(*heights), STRIP)[0].tolist() == torn


def test_an_edge_that_is_torn_already_is_measured_against_itself():
    """One vertex 60 cm off: lifting it by 5 cm does not stretch its edges by half."""
    points = FLAT + lifted(0.6, 0, 0, 0)
    assert not torn_away(points, lifted(0.05, 0, 0, 0), STRIP).any()


def test_frames_are_judged_each_by_itself():
    lifts = torch.cat([lifted(0.2, -0.03, -0.03, -0.03), lifted(0, 0, 0, 0)])
    assert torn_away(FLAT.repeat(2, 1, 1), lifts, STRIP).tolist() == [
        [True, False, False, False],
        [False] * 4,
    ]


def test_what_would_be_torn_away_has_no_plane_until_the_second_query():
    class TwoSides(HalfSpace):
        """The first vertex's way out is up, that of all others down."""

        def query(self, points):
            direction = torch.zeros_like(points)
            direction[..., 1] = torch.tensor([1.0, -1, -1, -1])
            return SdfQuery(torch.tensor([[-0.2, -0.03, -0.03, -0.03]]), direction, points)

    contact = Contact(TwoSides(), FLAT, margin_m=0.0, every_steps=4, topology=STRIP)
    contact.update_planes(FLAT)
    assert contact.normal[0, :, 1].tolist() == [0, -1, -1, -1]
    assert contact.offset[0, 0] < 0  # and hence holds nothing
    contact.update_planes(FLAT)
    assert contact.normal[0, :, 1].tolist() == [1, -1, -1, -1]
    np.testing.assert_allclose(contact.offset[0], [0.2, 0.03, 0.03, 0.03], atol=1e-7)
