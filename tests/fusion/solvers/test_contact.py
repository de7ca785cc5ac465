"""Planes below vertices, and steps that neither planes nor pins forbid, by hand."""

import numpy as np
import pytest
import torch

from fusion import Topology
from fusion.obstacles.sdf import SdfQuery
from fusion.obstacles.surface_contact import SurfaceContacts
from fusion.solvers.contact import ConstrainedStep, Contact
from fusion.solvers.energy import Energy
from fusion.solvers.memory import StepMemory
from render import Mesh
from tests.helpers.half_space import HalfSpace

TRIANGLE = Topology(Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])))


def step_of(vertices, gradient, *, loose=None, ground=None, margin=0.0):
    """A step from `vertices` (T, 3, 3) with planes taken there."""
    energy = Energy(
        TRIANGLE, {"displacement_m2": 1.0}, vertices, torch.full((1, 3), 1 / 3, dtype=vertices.dtype)
    )
    contact = None
    if ground is not None:
        contact = Contact(HalfSpace(ground), vertices, margin_m=margin, every_steps=4)
        contact.update_planes(vertices)
    step = ConstrainedStep(energy, loose, contact)
    step.vertices.copy_(vertices)
    step.gradient.copy_(gradient)
    return step, energy


def open_to(step, energy, direction):
    """A direction (T, N, 3), as far as it is open."""
    memory = StepMemory(energy, step)
    memory.solution.copy_(-direction)
    memory.lead()
    return step.direction


def at(*heights):
    """One frame of three vertices at these heights."""
    points = torch.zeros(1, 3, 3, dtype=torch.float64)
    points[0, :, 1], points[0, :, 0] = torch.tensor(heights), torch.arange(3.0)
    return points


def test_planes_by_hand():
    """Ground at 0.5 m with a margin of 0.1 m: all planes are y = 0.6."""
    contact = Contact(HalfSpace(0.5), at(0.0, 0.0, 0.0), margin_m=0.1, every_steps=4)
    contact.update_planes(at(0.3, 0.6, 2.0))
    assert contact.normal.tolist() == [[[0, 1, 0]] * 3]
    np.testing.assert_allclose(contact.offset, [[0.6] * 3])
    assert contact.depth.item() == pytest.approx(0.3 / 3)  # the first alone lies below


def test_it_is_time_for_a_query_at_every_so_many_steps():
    contact = Contact(HalfSpace(), at(0.0, 0.0, 0.0), margin_m=0.0, every_steps=4)
    assert [step for step in range(10) if contact.due(step)] == [0, 4, 8]


def test_the_cloth_between_vertices_is_looked_at_in_the_second_query_and_stays_raised():
    """The triangle's middle is in the ground by a millimetre, its corners are not: at the second query they
    rise by as much, and keep it at the third, where nothing is looked at."""

    class Middle:
        def __init__(self):
            self.calls = 0

        def find(self, vertices, distance):
            self.calls += 1
            none, third = torch.zeros(1, dtype=torch.int64), torch.full((1, 3), 1 / 3).double()
            up = torch.tensor([[0.0, 1, 0]]).double()
            return SurfaceContacts(none, torch.arange(3)[None], third, up, torch.full((1,), 1e-3).double())

    surface = Middle()
    contact = Contact(HalfSpace(0.0), at(0.0, 0.0, 0.0), margin_m=0.0, every_steps=4, surface=surface)
    contact.update_planes(at(0.0, 0.0, 0.0))
    assert (surface.calls, contact.offset.tolist()) == (0, [[0.0] * 3])
    contact.update_planes(at(0.0, 0.0, 0.0))
    assert surface.calls == 1
    np.testing.assert_allclose(contact.offset, [[1e-3] * 3])
    contact.update_planes(at(0.5, 0.5, 0.5))
    assert surface.calls == 1
    np.testing.assert_allclose(contact.offset, [[1e-3] * 3])


def test_only_what_touches_and_is_pressed_down_slides_along_its_plane():
    """The vertices: touching and pressed down; touching and pulled up; pressed down from far above."""
    vertices = at(0.0, 0.0, 1.0)
    gradient = torch.tensor([[[0.0, 1, 0], [0, -1, 0], [0, 1, 0]]], dtype=torch.float64)
    step, energy = step_of(vertices, gradient, ground=0.0)
    found = open_to(step, energy, torch.tensor([[[1.0, -2, 3]] * 3]))
    assert found.tolist() == [[[1, 0, 3], [1, -2, 3], [1, -2, 3]]]


@pytest.mark.parametrize(("height", "slides"), [(-1e-3, True), (9e-6, True), (2e-5, False)])
def test_what_is_nearer_than_a_hundredth_of_a_millimetre_touches(height, slides):
    step, energy = step_of(at(height, 1.0, 1.0), at(1.0, 1.0, 1.0), ground=0.0)
    assert (open_to(step, energy, torch.full((1, 3, 3), -1.0))[0, 0, 1] == 0) == slides


def test_a_step_ends_on_the_planes_and_not_below():
    """Down by 1 m from 0.4, 1 and 3 m: the first is brought back up to the ground, sideways it goes on."""
    step, energy = step_of(at(0.4, 1.0, 3.0), at(0.0, 0.0, 0.0), ground=0.0, margin=0.1)
    step.direction.copy_(torch.tensor([[[0.5, -1, 0]] * 3]))
    step.advance()
    np.testing.assert_allclose(energy.vertices[0, :, 1], [0.1, 0.1, 2.0])
    np.testing.assert_allclose(energy.vertices[0, :, 0], [0.5, 1.5, 2.5])


def test_every_frame_has_its_own_length_and_idle_frames_stay():
    vertices = at(0.0, 0.0, 0.0).repeat(3, 1, 1)
    step, energy = step_of(vertices, 0 * vertices)
    energy.vertices.fill_(7.0)
    energy.activate(torch.tensor([True, False, True]))
    step.direction.copy_(torch.tensor([0.0, 1, 0]).double().expand(3, 3, 3))
    step.length.copy_(torch.tensor([0.5, 1.0, 0.0]))
    step.advance()
    assert energy.vertices[0, :, 1].tolist() == [0.5] * 3
    assert energy.vertices[1].eq(7.0).all()
    assert torch.equal(energy.vertices[2], vertices[2])


@pytest.mark.parametrize("ground", [None, 0.0])
def test_pinned_vertices_go_nowhere_not_even_out_of_the_ground(ground):
    loose = torch.tensor([False, True, True])
    vertices = at(-0.2, 1.0, 1.0)
    step, energy = step_of(vertices, 0 * vertices, loose=loose, ground=ground)
    assert open_to(step, energy, torch.full((1, 3, 3), 0.25))[0, :, 0].tolist() == [0, 0.25, 0.25]
    step.advance()
    assert torch.equal(energy.vertices[0, 0], vertices[0, 0])
    np.testing.assert_allclose(energy.vertices[0, 1:, 1], 1.25)


def test_far_from_any_obstacle_all_directions_are_open():
    """Beyond an obstacle's band its direction is 0, and so is the plane's normal."""

    class Nothing(HalfSpace):
        def query(self, points):
            return SdfQuery(torch.full(points.shape[:-1], 0.05), 0 * points, points)

    vertices = at(0.0, -1.0, -9.0)
    energy = Energy(TRIANGLE, {}, vertices, torch.ones(1, 3, dtype=torch.float64))
    contact = Contact(Nothing(), vertices, margin_m=0.0, every_steps=1)
    contact.update_planes(vertices)
    step = ConstrainedStep(energy, None, contact)
    step.vertices.copy_(vertices)
    step.gradient.fill_(1.0)
    assert open_to(step, energy, torch.full((1, 3, 3), -2.0)).eq(-2.0).all()
    step.advance()
    torch.testing.assert_close(energy.vertices, vertices - 2)
    assert contact.depth.item() == 0
