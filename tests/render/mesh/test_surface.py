"""Texture coordinates and materials that mesh files bring along."""

import numpy as np
import pytest
import trimesh

from render import InputError, load_mesh
from render.files.mtl import textures
from render.mesh.surface import Surface, plain_surface

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def obj(tmp_path, text):
    path = tmp_path / "mesh.obj"
    path.write_text(text)
    return path


def test_obj_by_hand(tmp_path):
    (tmp_path / "look.mtl").write_text("newmtl red\nKd 1 0 0\n")
    path = obj(
        tmp_path,
        f"mtllib look.mtl\n{QUAD}vt 0 0\nvt 1 0 0\nvt 0.5\nusemtl red\nf 1/1 2/2 3/3 4/-3\n"
        "usemtl light blue\nf 1/1/1 2/2/1 4/3/1\n",
    )
    surface = load_mesh(path).surface
    np.testing.assert_array_equal(surface.uvs, [[0, 0], [1, 0], [0.5, 0]])  # v is 0 where it is not given
    np.testing.assert_array_equal(surface.uv_faces, [[0, 1, 2], [0, 2, 0], [0, 1, 2]])
    np.testing.assert_array_equal(surface.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 3]])
    assert surface.materials == ("red", "light blue")
    np.testing.assert_array_equal(surface.face_materials, [0, 0, 1])
    assert surface.mtl == "newmtl red\nKd 1 0 0\n"
    assert surface.has_look


def test_faces_without_coordinates_or_material_say_so(tmp_path):
    surface = load_mesh(
        obj(tmp_path, f"{QUAD}vt 0 0\nf 1 2 3\nusemtl red\nf 1/1 3/1 4/1\nf 1/1 2 3\n")
    ).surface
    np.testing.assert_array_equal(surface.uv_faces, [[-1, -1, -1], [0, 0, 0], [-1, -1, -1]])
    assert surface.materials == ("red", "default")
    np.testing.assert_array_equal(surface.face_materials, [1, 0, 0])
    assert surface.mtl == ""


def test_a_plain_obj_has_no_surface(tmp_path):
    assert load_mesh(obj(tmp_path, f"{QUAD}vt 0 0\nf 1 2 3\n")).surface is None


def test_textures_get_full_paths_where_they_exist(tmp_path):
    (tmp_path / "cloth.png").write_bytes(b"png")
    (tmp_path / "look.mtl").write_text(
        "newmtl a\nmap_Kd cloth.png\nmap_Bump -bm 1 cloth.png\nmap_Kd gone.png\nKd 1 0 0\n"
    )
    surface = load_mesh(obj(tmp_path, f"mtllib look.mtl\n{QUAD}usemtl a\nf 1 2 3\n")).surface
    image = (tmp_path / "cloth.png").resolve()
    assert surface.mtl == f"newmtl a\nmap_Kd {image}\nmap_Bump -bm 1 {image}\nmap_Kd gone.png\nKd 1 0 0\n"


def test_textures_with_spaces_and_libraries_that_are_none(tmp_path):
    (tmp_path / "my cloth.png").write_bytes(b"png")
    (tmp_path / "look.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 my cloth.png\nmap_Kd other.png\n")
    (tmp_path / "secret.txt").write_text("not for you")
    text = f"mtllib look.mtl\nmtllib secret.txt\n{QUAD}usemtl a\nf 1 2 3\n"
    mtl = load_mesh(obj(tmp_path, text)).surface.mtl
    assert "not for you" not in mtl  # only material libraries are taken in
    assert textures(mtl) == [str((tmp_path / "my cloth.png").resolve()), "other.png"]
    assert textures("") == textures("map_Kd\n") == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{QUAD}vt x 0\nf 1 2 3\n", "line 5 is not a valid texture coordinate"),
        (f"{QUAD}vt 0 0\nf 1/1 2/9 3/1\n", "texture coordinate 9, but only 1..1 exist"),
        (f"{QUAD}vt 0 0\nf 1/a 2/1 3/1\n", "line 6 is not a valid vertex or face"),
    ],
)
def test_bad_coordinates_are_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_mesh(obj(tmp_path, text))


HEAD = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 2\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v"])
def test_ply_with_coordinates_at_vertices(tmp_path, names):
    properties = "".join(f"property float {name}\n" for name in names.split())
    rows = "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n3 0 1 2\n3 0 2 3\n"
    (tmp_path / "a.ply").write_text(f"{HEAD}{properties}{FACE}end_header\n{rows}")
    mesh = load_mesh(tmp_path / "a.ply")
    assert len(mesh.vertices) == 4
    np.testing.assert_array_equal(mesh.surface.uvs[mesh.surface.uv_faces], mesh.vertices[mesh.faces][..., :2])


def test_ply_with_coordinates_at_corners_keeps_its_vertices(tmp_path):
    rows = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 .5 .5 1 1 0 1\n"
    (tmp_path / "a.ply").write_text(f"{HEAD}{FACE}property list uchar float texcoord\nend_header\n{rows}")
    mesh = load_mesh(tmp_path / "a.ply")
    assert mesh.vertices.shape == (4, 3)
    wanted = [[[0, 0], [1, 0], [1, 1]], [[0.5, 0.5], [1, 1], [0, 1]]]
    np.testing.assert_array_equal(mesh.surface.uvs[mesh.surface.uv_faces], wanted)


def test_glb_with_coordinates(tmp_path):
    vertices, faces = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0]]), np.array([[0, 1, 2]])
    visual = trimesh.visual.TextureVisuals(uv=vertices[:, :2], material=trimesh.visual.material.PBRMaterial())
    trimesh.Trimesh(vertices, faces, visual=visual, process=False).export(tmp_path / "a.glb")
    surface = load_mesh(tmp_path / "a.glb").surface
    np.testing.assert_allclose(surface.uvs[surface.uv_faces][0], vertices[:, :2], atol=1e-6)


def test_moved_vertices_go_back_to_the_file():
    # Vertices 0 and 2 of the file are one vertex of the mesh.
    surface = Surface(np.array([[0, 1, 3]]), np.array([1, 0, 1, 2]))
    moved = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(surface.of_file(moved), moved[[1, 0, 1, 2]])
    assert surface.of_file(np.stack([moved, moved])).shape == (2, 4, 3)
    assert not surface.has_look
    assert not plain_surface(np.array([[0, 1, 2]]), 3).has_look
