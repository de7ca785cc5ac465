"""Lines of OBJ files, one by one."""

import numpy as np
import pytest

from render import InputError
from render.files.mtl import textures
from render.files.obj import read_obj

CORNERS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 2 0\n"


def read(tmp_path, text):
    (tmp_path / "a.obj").write_text(text)
    return read_obj(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("face", "want"),
    [
        ("f 1 2 3", [[0, 1, 2]]),
        ("f 1 2 3 4 5", [[0, 1, 2], [0, 2, 3], [0, 3, 4]]),  # a fan around the first corner
        ("f -5 -4 -1", [[0, 1, 4]]),
        ("f 1/7/2 2//3 3", [[0, 1, 2]]),  # one without coordinates: the face has none
        ("f\t1  2 3 # a comment", [[0, 1, 2]]),
        ("f 1 1 1", [[0, 0, 0]]),
    ],
)
def test_faces(tmp_path, face, want):
    vertices, faces, surface = read(tmp_path, CORNERS + face)
    assert faces.tolist() == want
    assert faces.dtype == np.int64
    assert vertices.shape == (5, 3)
    assert surface is None


def test_indices_from_behind_count_from_where_they_stand(tmp_path):
    """-1 is the latest vertex so far, not the last of the file."""
    first, second = CORNERS.split("v 0 1 0\n")
    _, faces, _ = read(tmp_path, first + "f -3 -2 -1\nv 0 1 0\n" + second + "f -3 -2 -1\n")
    assert faces.tolist() == [[0, 1, 2], [2, 3, 4]]


@pytest.mark.parametrize(
    "line", ["f 1 2", "f", "v 1 2", "v a b c", "f 1 2 x", "f 1 2 9999999999", "vt 1e7 0", "vt nan 0"]
)
def test_lines_that_cannot_be_read_are_named_by_their_number(tmp_path, line):
    what = "texture coordinate" if line.startswith("vt") else "vertex or face"
    with pytest.raises(InputError, match=rf"a\.obj: line 7 is not a valid {what}: '{line}'"):
        read(tmp_path, CORNERS + "# seventh\n" + line + "\n")


def test_weights_and_colours_after_a_vertex_and_unknown_lines_are_let_be(tmp_path):
    text = "o shirt\ns 1\nv 1 2 3 0.5 0.5 0.5\nv 4 5 6 1\nvn 0 0 1\nl 1 2\ncurv 0 1\n"
    vertices, faces, _ = read(tmp_path, text)
    assert vertices.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert faces.shape == (0, 3)


def test_coordinates_of_a_quad_go_with_its_corners(tmp_path):
    text = CORNERS + "vt 0 0\nvt 1\nvt 1 1 0\nvt 0 1\nf 1/4 2/3 3/2 4/1\nf 1/-1 2/-2 3/-3\nf 3 4 5\n"
    _, _, surface = read(tmp_path, text)
    assert surface.uvs.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert surface.uv_faces.tolist() == [[3, 2, 1], [3, 1, 0], [3, 2, 1], [-1, -1, -1]]


def test_faces_before_the_first_material_have_one_of_their_own(tmp_path):
    text = CORNERS + "f 1 2 3\nusemtl red cloth\nf 1 3 4\nusemtl blue\nf 3 4 5\nusemtl red cloth\nf 1 2 5\n"
    _, _, surface = read(tmp_path, text)
    assert surface.materials == ("red cloth", "blue", "default")
    assert surface.face_materials.tolist() == [2, 0, 1, 0]


def test_only_libraries_are_read_and_each_once(tmp_path):
    (tmp_path / "a b.mtl").write_text("newmtl red\n")
    (tmp_path / "secret.txt").write_text("password\n")
    text = "mtllib a b.mtl\nmtllib secret.txt\nmtllib missing.mtl\nmtllib a b.mtl\n" + CORNERS
    _, _, surface = read(tmp_path, text + "usemtl red\nf 1 2 3\n")
    assert surface.mtl == "newmtl red\n"


def test_images_of_a_library_are_named_once_with_their_spaces():
    mtl = "newmtl a\nmap_Kd -s 1 1 /cloth/red cloth.png\nmap_Kd red.png\nmap_Kd red.png\nmap_Ks shine.png\nmap_Kd\n"
    assert textures(mtl) == ["/cloth/red cloth.png", "red.png"]
    assert textures(mtl, "map_Ks") == ["shine.png"]
    assert textures("") == []
