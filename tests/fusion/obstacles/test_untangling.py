"""Cloth that passes through itself is taken apart: by hand-made tangles, and laws."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fusion import FusionConfig, fuse
from fusion.obstacles import Untangler, edges_through_own_faces
from fusion.topology import Topology
from render import Mesh
from render.mesh.measures import edge_lengths
from tests.helpers.fusion_examples import imager_of, inputs_of, tube
from tests.helpers.half_space import HalfSpace

SIDE, CELL = 12, 0.01  # vertices and metres


def sheet(z: float) -> np.ndarray:
    """(SIDE², 3) a level square."""
    x, y = np.meshgrid(np.arange(SIDE) * CELL, np.arange(SIDE) * CELL)
    return np.stack([x.ravel(), y.ravel(), np.full(SIDE * SIDE, z)], axis=1)


def two_sheets() -> Mesh:
    """Two squares one above the other, of one mesh, which lie apart at rest."""
    row, column = (part.ravel() for part in np.mgrid[: SIDE - 1, : SIDE - 1])
    a = row * SIDE + column
    faces = np.concatenate([np.stack([a, a + 1, a + SIDE + 1], 1), np.stack([a, a + SIDE + 1, a + SIDE], 1)])
    return Mesh(np.concatenate([sheet(0), sheet(0.1)]), np.concatenate([faces, faces + SIDE * SIDE]))


MESH = two_sheets()
TOPOLOGY = Topology(MESH)


def tangled(dip: float = 0.012, apart: float = 0.005) -> torch.Tensor:
    """(1, 2 SIDE², 3): the upper square with a dent in its middle that comes out below the lower one."""
    upper = sheet(apart)
    middle = (SIDE - 1) * CELL / 2
    away = np.hypot(upper[:, 0] - middle, upper[:, 1] - middle)
    upper[:, 2] -= dip * np.clip(1 - away / (2.5 * CELL), 0, 1)
    return torch.from_numpy(np.concatenate([sheet(0), upper])).float()[None]


def count(vertices: torch.Tensor, mesh: Mesh = MESH) -> list[int]:
    return edges_through_own_faces(vertices.numpy(), mesh.edges, mesh.faces).counts().tolist()


def test_a_dent_through_a_sheet_comes_out_and_edges_keep_their_lengths():
    start = tangled()
    assert count(start)[0] > 10
    result = Untangler(TOPOLOGY, None).untangled(start)
    assert count(result) == [0]
    stretch = edge_lengths(result.numpy(), MESH.edges) / edge_lengths(MESH.vertices, MESH.edges)
    assert stretch.max() < 1.15
    assert stretch.min() > 0.85
    moved = (result - start).norm(dim=-1)
    assert moved.max() < 0.02
    assert torch.equal(result[0, 0], start[0, 0])  # a corner, far from the dent


def test_what_does_not_cross_stays_to_the_bit():
    start = torch.cat([tangled(dip=0.0), tangled()])
    result = Untangler(TOPOLOGY, None).untangled(start)
    assert torch.equal(result[0], start[0])
    assert not torch.equal(result[1], start[1])


def test_a_batch_equals_its_single_frames_whatever_came_before():
    frames = torch.cat([tangled(), tangled(0.02), tangled(0.0), tangled(0.015, 0.003)])
    untangler = Untangler(TOPOLOGY, None)
    batch = untangler.untangled(frames)
    for k in (2, 0, 3, 1):
        assert torch.equal(untangler.untangled(frames[k : k + 1])[0], batch[k])


def test_rigid_motion_moves_the_result_along():
    turn = torch.from_numpy(Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()).float()
    start = tangled()
    result = Untangler(TOPOLOGY, None).untangled(start)
    turned = Untangler(TOPOLOGY, None).untangled(start @ turn.T + 0.1)
    assert count(turned) == [0]
    # Rounding decides between equal choices now and then, so places agree to a part of a cell only.
    torch.testing.assert_close(turned, result @ turn.T + 0.1, rtol=0, atol=0.3 * CELL)


def test_pinned_vertices_do_not_move():
    fixed = torch.zeros(2 * SIDE * SIDE, dtype=torch.bool)
    fixed[: SIDE * SIDE] = True  # the whole lower sheet
    start = tangled()
    result = Untangler(TOPOLOGY, fixed).untangled(start)
    assert torch.equal(result[0, fixed], start[0, fixed])
    assert count(result) == [0]


def test_what_is_moved_keeps_out_of_the_obstacle():
    """The dent leans on a half space: y up there, so the sheets stand on their sides."""
    up = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    start = tangled() @ up.T
    ground = HalfSpace(float(start[..., 1].min()) - 0.001)
    result = Untangler(TOPOLOGY, None).untangled(start, ground, 0.001)
    assert count(result) == [0]
    assert result[..., 1].min() >= start[..., 1].min() - 1e-6


def test_faces_without_area_do_no_harm():
    start = tangled()
    start[0, SIDE * SIDE : SIDE * SIDE + 2] = start[0, SIDE * SIDE]
    result = Untangler(TOPOLOGY, None).untangled(start)
    assert bool(torch.isfinite(result).all())
    assert count(result)[0] <= count(start)[0]


@pytest.mark.parametrize("solver", ["local_global", "adam"])
def test_a_fused_garment_does_not_pass_through_itself_with_self_contact(solver):
    """Initial vertices of a tube one of whose walls is pressed through the other; maps are not given."""
    mesh = tube()
    start = torch.from_numpy(mesh.vertices.astype(np.float32))[None].clone()
    front = start[0, :, 2] > 0.1
    start[0, front, 2] -= 0.265 * torch.cos(start[0, front, 1] * np.pi / 0.4) ** 2
    settings = {"solver": solver, "edge_steps": 0, "edge_iterations": 0}
    without, apart = (
        fuse(imager_of(mesh), inputs_of(initial=start), config=FusionConfig(**settings, self_contact=contact))
        for contact in (False, True)
    )
    assert without.report["self_crossing_percent"] > 0
    assert apart.report["self_crossing_percent"] == 0
    assert "self_contact" in apart.report["stage_seconds"]
    assert "self_contact" not in without.report["stage_seconds"]


def test_frames_that_cross_only_once_they_are_smoothed_are_taken_apart_too():
    """Seven frames in which the upper sheet is above the lower one and below it by turns: halfway, its dent crosses."""
    above, below = tangled(dip=0.0, apart=0.035), tangled(dip=0.03, apart=-0.033)
    start = torch.cat([above, below] * 3 + [above])
    assert count(start) == [0] * 7
    inputs = replace(inputs_of(initial=start), fps=30.0)
    crossing, apart = (
        fuse(imager_of(MESH), inputs, FusionConfig(smooth_time_s=0.5, self_contact=contact)).vertices
        for contact in (False, True)
    )
    middle = slice(2, 5)
    assert min(count(torch.from_numpy(crossing))[middle]) > 0
    assert count(torch.from_numpy(apart))[middle] == [0] * 3
