import numpy as np
import pytest
import trimesh
from example_meshes import tube

from render import InputError, load_mesh


def test_obj_keeps_its_vertices_in_order(tmp_path):
    # Texture seams, a vertex no face uses, a quad, backward indices, comments and colours.
    path = tmp_path / "shirt.obj"
    path.write_text(
        "# a comment\nmtllib none.mtl\nv 0 0 0 # first\nv 1 0 0 0.5 0.5 0.5\nv 1 1 0\nv 0 1 0\nv 5 5 5\n"
        "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\ng part\n\nf 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\nf 1 2 3 4\nf -5 -4 -3\n"
    )
    mesh = load_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]])
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3], [0, 1, 2]])
    assert mesh.source == str(path)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_vertex_order_survives_a_round_trip(tmp_path, suffix):
    mesh = tube(12, 8)
    path = tmp_path / f"tube{suffix}"
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
    read = load_mesh(str(path))
    np.testing.assert_allclose(read.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(read.faces, mesh.faces)


def test_stl_corners_are_joined(tmp_path):
    mesh = tube(12, 8)
    trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(tmp_path / "tube.stl")
    read = load_mesh(tmp_path / "tube.stl")
    assert read.vertices.shape == mesh.vertices.shape
    np.testing.assert_allclose(read.vertices[read.faces], mesh.vertices[mesh.faces], atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 9\n", r"face 0 uses vertices \[0, 1, 8\], but only 0\.\.2 exist"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 0 1 2\n", "count from 1"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\nf -9 1 2\n", "uses vertices"),
        ("v 0 0 0\nv 1 0 0\nv 1 1 0\n", "no faces"),
        ("", "no faces"),
        ("v 0 0 nan\nv 1 0 0\nv 1 1 0\nf 1 2 3\n", "vertex 0 is .* not finite"),
        ("v 0 0\n", "line 1 is not a valid vertex"),
        ("v 0 0 0\nf 1 x 1\n", "line 2 is not a valid vertex or face"),
        ("v 0 0 0\nv 1 0 0\nf 1 2\n", "line 3 is not a valid"),
    ],
)
def test_bad_obj(tmp_path, content, message):
    path = tmp_path / "bad.obj"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        load_mesh(path)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".stl"])
def test_broken_files_of_other_formats(tmp_path, suffix):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(b"\x00\x01 no mesh at all")
    with pytest.raises(InputError, match=f"broken{suffix}"):
        load_mesh(path)


def test_a_point_cloud_is_refused(tmp_path):
    trimesh.PointCloud(np.random.default_rng(0).normal(size=(5, 3))).export(tmp_path / "points.ply")
    with pytest.raises(InputError, match="no faces"):
        load_mesh(tmp_path / "points.ply")


def test_missing_files_and_unknown_formats(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_mesh(tmp_path / "none.obj")
    with pytest.raises(InputError, match=r"must be one of \.obj"):
        load_mesh(tmp_path / "shirt.fbx")
