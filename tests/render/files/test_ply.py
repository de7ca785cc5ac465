"""PLY of other programs, with the values by hand."""

from __future__ import annotations

import struct
from pathlib import Path

import meshio
import numpy as np
import pytest

from render import InputError, load_mesh

PLACES = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, 0]]
VERTEX = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
ROWS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n.5 2 0\n"
FACE = "element face 2\nproperty list uchar int vertex_indices\n"
FACES = [[0, 1, 2], [0, 2, 3], [3, 2, 4]]


def read(tmp_path: Path, head: str, body: str | bytes, kind: str = "ascii"):
    text = f"ply\nformat {kind} 1.0\n{head}end_header\n".encode()
    (tmp_path / "a.ply").write_bytes(text + (body.encode() if isinstance(body, str) else body))
    return load_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize("sign", ["<", ">"])
def test_binary_polygons_of_any_mix(tmp_path, sign):
    kind = f"binary_{'little' if sign == '<' else 'big'}_endian"
    body = struct.pack(f"{sign}15f", *np.ravel(PLACES)) + struct.pack(
        f"{sign}B4iB3i", 4, 0, 1, 2, 3, 3, 3, 2, 4
    )
    mesh = read(tmp_path, VERTEX + FACE, body, kind)
    assert mesh.vertices.tolist() == PLACES
    assert mesh.faces.tolist() == FACES


def test_corner_coordinates_with_numbers_of_images_as_meshlab_writes_them(tmp_path):
    head = "comment TextureFile front.png\ncomment TextureFile back side.png\n" + VERTEX + FACE
    head += "property list uchar float texcoord\nproperty int texnumber\nproperty uchar red\n"
    (tmp_path / "front.png").write_bytes(b"png")
    rows = "4 0 1 2 3  8 0 0 1 0 1 1 0 1  1 255\n3 3 2 4  6 0 .5 1 .5 .5 1  0 7\n"
    surface = read(tmp_path, head, ROWS + rows).surface
    uvs = [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]], [[0, 0.5], [1, 0.5], [0.5, 1]]]
    assert surface.uvs[surface.uv_faces].tolist() == uvs
    assert [surface.materials[number] for number in surface.face_materials] == [
        "back side",
        "back side",
        "front",
    ]
    image = (tmp_path / "front.png").resolve()
    assert surface.mtl == f"newmtl front\nmap_Kd {image}\nnewmtl back side\nmap_Kd back side.png\n"


def test_faces_without_coordinates_among_others(tmp_path):
    rows = "4 0 1 2 3 0\n3 3 2 4 6 0 .5 1 .5 .5 1\n"
    surface = read(tmp_path, VERTEX + FACE + "property list uchar float texcoord\n", ROWS + rows).surface
    assert surface.uv_faces.tolist() == [[-1] * 3, [-1] * 3, [0, 1, 2]]


def test_coordinates_at_vertices_beside_normals_and_colours_in_any_order(tmp_path):
    names = ["t", "red", "z", "nx", "s", "x", "y"]
    head = "element vertex 3\n" + "".join(
        f"property {'uchar' if n == 'red' else 'double'} {n}\n" for n in names
    )
    head += (
        "element edge 1\nproperty int vertex1\nproperty int vertex2\nelement face 1\nproperty float quality\n"
    )
    head += "property list uint uint vertex_index\n"
    mesh = read(tmp_path, head, ".25 255 3 0 .5 1 2\n.75 0 6 0 1 4 5\n1 9 9 1 0 7 8\n0 1\n.5 3 0 1 2\n")
    assert mesh.vertices.tolist() == [[1, 2, 3], [4, 5, 6], [7, 8, 9]]
    assert mesh.surface.uvs.tolist() == [[0.5, 0.25], [1, 0.75], [0, 1]]
    assert mesh.surface.uv_faces.tolist() == [[0, 1, 2]]


def test_vertices_that_no_face_uses_and_faces_before_vertices(tmp_path):
    mesh = read(tmp_path, FACE.replace("2", "1") + VERTEX, "3 0 1 2\n" + ROWS)
    assert mesh.vertices.tolist() == PLACES
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("binary", [True, False])
def test_what_meshio_writes(tmp_path, binary):
    cells = [("quad", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[3, 2, 4]]))]
    meshio.Mesh(np.array(PLACES, float), cells).write(tmp_path / "a.ply", binary=binary)
    mesh = load_mesh(tmp_path / "a.ply")
    np.testing.assert_allclose(mesh.vertices, PLACES)
    assert mesh.faces.tolist() == FACES


@pytest.mark.parametrize(
    ("head", "body", "message"),
    [
        (VERTEX + FACE, ROWS + "3 0 1 2\n", "ends"),
        (VERTEX + FACE, ROWS + "3 0 1 2\n2 0 1\n", "face 1 has fewer than three corners"),
        (VERTEX + FACE, ROWS + "3 0 1 2\n-3 0 1\n", "a list of -3"),
        (VERTEX + FACE, ROWS + "3 0 1 x\n", "something else than numbers"),
        (VERTEX + FACE + "property list uchar float texcoord\n", ROWS + "3 0 1 2 4 0 0 1 1\n3 0 1 2 0\n",
         "two numbers a corner"),
        (VERTEX.replace(" z", " depth") + FACE, ROWS + "3 0 1 2\n" * 2, "no vertices with x, y and z"),
        (VERTEX + "element tristrips 1\nproperty list int int vertex_indices\n", ROWS + "3 0 1 2\n", "tristrips"),
        (VERTEX.replace("float x", "half x") + FACE, ROWS, "line 'property half x'"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_read(tmp_path, head, body, message):
    with pytest.raises(InputError, match=rf"a\.ply: .*{message}"):
        read(tmp_path, head, body)
