import numpy as np
import pytest
import trimesh

from imgtransfer.bodies.anny import load_body
from imgtransfer.garments.checks import intersecting_faces, mesh_quality
from render.mesh.mesh import Mesh

FLAT = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def pair(second):
    return Mesh(np.array(FLAT + second, float), np.array([[0, 1, 2], [3, 4, 5]]))


def crossing_by_loop(mesh):
    """Faces that a side of another passes through, or whose side passes through another: a plain loop."""
    found = set()
    owners = {}
    for number, corners in enumerate(np.sort(mesh.faces, axis=1).tolist()):
        for edge in ((corners[0], corners[1]), (corners[1], corners[2]), (corners[0], corners[2])):
            owners.setdefault(edge, []).append(number)
    for edge, sides in owners.items():
        start, end = mesh.vertices[list(edge)]
        for number, corners in enumerate(mesh.faces.tolist()):
            if set(corners) & set(edge):
                continue
            a, b, c = mesh.vertices[corners]
            system = np.stack([b - a, c - a, start - end], axis=1)
            if abs(np.linalg.det(system)) > 1e-15:
                u, v, t = np.linalg.solve(system, start - a)
                if u > 0 and v > 0 and u + v < 1 and 0 < t < 1:
                    found |= {number, *sides}
    return found


def rays_through_faces(mesh):
    """Faces that a side of another passes through, by Embree."""
    rays = trimesh.ray.ray_pyembree.RayMeshIntersector(
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    )
    start, end = (mesh.vertices[mesh.edges[:, side]] for side in (0, 1))
    length = np.linalg.norm(end - start, axis=1)
    face, ray, place = rays.intersects_id(
        start, (end - start) / length[:, None], multiple_hits=True, return_locations=True
    )
    way = np.linalg.norm(place - start[ray], axis=1) / length[ray]
    apart = ~(mesh.faces[face][:, :, None] == mesh.edges[ray][:, None, :]).any(axis=(1, 2))
    return set(face[apart & (way < 1)].tolist())


def test_two_crossing_triangles_intersect_and_parallel_ones_do_not():
    assert intersecting_faces(pair([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.3, 1]])).tolist() == [1, 0]
    assert intersecting_faces(pair([[0, 0, 0.1], [1, 0, 0.1], [0, 1, 0.1]])).tolist() == [-1, -1]
    # One that only its plane meets, and one whose side passes by outside.
    assert intersecting_faces(pair([[2, 2, -1], [2.1, 2, 1], [2, 2.1, 1]])).tolist() == [-1, -1]


def test_faces_with_a_common_corner_intersect_where_they_meet_elsewhere():
    points = np.array([*FLAT, [0.5, 0.2, -1], [0.5, 0.2, 1], [-0.5, 0.2, -1], [-0.5, 0.2, 1]], float)
    through, aside = np.array([[0, 1, 2], [0, 3, 4]]), np.array([[0, 1, 2], [0, 5, 6]])
    assert intersecting_faces(Mesh(points, through)).tolist() == [1, 0]
    assert intersecting_faces(Mesh(points, aside)).tolist() == [-1, -1]


def test_nearly_coplanar_neighbours_do_not_intersect():
    """`wp.intersect_tri_tri` of Warp 1.19 says that some of them do."""
    body = load_body()
    assert mesh_quality(Mesh(body.rest, body.faces)).intersecting == 0


def test_intersections_are_those_that_a_plain_loop_finds():
    ball = trimesh.creation.icosphere(1, 0.1)
    vertices = np.concatenate([ball.vertices, ball.vertices * 0.9 + [0.11, 0.013, 0.007]])
    mesh = Mesh(vertices, np.concatenate([ball.faces, ball.faces + len(ball.vertices)]))
    found = set(np.flatnonzero(intersecting_faces(mesh) >= 0).tolist())
    assert len(found) > 20
    assert found == crossing_by_loop(mesh)


def test_an_arm_through_the_belly_is_found_where_rays_find_it():
    body = load_body()
    moved = body.rest.astype(float).copy()
    moved[moved[:, 0] > 0.25] -= [0.32, 0.05, 0.18]  # the left forearm and hand
    mesh = Mesh(moved, body.faces)
    found = set(np.flatnonzero(intersecting_faces(mesh) >= 0).tolist())
    rays = rays_through_faces(mesh)
    assert len(rays) > 60
    assert rays <= found
    assert len(found) < 2 * len(rays)  # rays find the face that is passed through, and not the side's own


def test_the_numbers_of_a_small_sheet():
    # Two right triangles that make a square: one border, a fold of nothing, angles of 45 and 90 degrees.
    square = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float), np.array([[0, 1, 2], [0, 2, 3]])
    )
    quality = mesh_quality(square)
    assert (quality.components, quality.openings, quality.handles, quality.non_manifold) == (1, 1, 0, 0)
    assert quality.angle_min == pytest.approx(45)
    assert quality.edge_median == 1.0


def test_pinched_and_turned_meshes_are_not_manifold():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], float)
    assert (
        mesh_quality(Mesh(points, np.array([[0, 1, 2], [0, 3, 4]]))).non_manifold == 1
    )  # they touch in a corner
    assert (
        mesh_quality(Mesh(points[:4], np.array([[0, 1, 2], [0, 3, 2]]))).non_manifold > 0
    )  # one is turned over


def test_duplicated_vertices_are_counted():
    assert mesh_quality(pair([[0, 0, 0], [0, -1, 0], [-1, 0, 0]])).duplicates == 1


def test_a_torus_has_a_handle():
    torus = trimesh.creation.torus(1.0, 0.3, 12, 8)
    quality = mesh_quality(Mesh(torus.vertices, torus.faces))
    assert (quality.openings, quality.handles) == (0, 1)
