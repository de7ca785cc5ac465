import json
import os
import struct

import numpy as np
import pytest
import trimesh

from render import InputError, load_mesh
from tests.helpers.example_meshes import tube


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


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 1 1 0\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TRIANGLE + "f 1 2 99999999999999999999\n", "line 4 is not a valid vertex or face"),
        (TRIANGLE + "f 1 2 -99999999999999999999\n", "line 4 is not a valid vertex or face"),
        (TRIANGLE + "f 1 2 " + "9" * 5000 + "\n", "line 4 is not a valid vertex or face"),
        (TRIANGLE + "f 1 2 ²\n", "line 4 is not a valid vertex or face"),
        (TRIANGLE + "f 1/99999999999999999999 2/1 3/1\n", "line 4 is not a valid vertex or face"),
        (TRIANGLE + "vt 0 0\nf 1/-9 2/1 3/1\n", r"texture coordinate -9, but only 1\.\.1"),
        (TRIANGLE + "vt nan 0\nf 1/1 2/1 3/1\n", "line 4 is not a valid texture coordinate"),
        (TRIANGLE + "vt 1e300 0\nf 1/1 2/1 3/1\n", "line 4 is not a valid texture coordinate"),
        ("v 0 0 1e300\n" + TRIANGLE + "f 1 2 3\n", r"vertex 0 is \[0.0, 0.0, 1e\+300\], beyond ±1e\+09"),
        ("v 0 0 1e999\n" + TRIANGLE + "f 1 2 3\n", "vertex 0 is .* not finite"),
        (TRIANGLE + "f\n", "line 4 is not a valid vertex or face"),
    ],
)
def test_obj_numbers_that_cannot_be_meant(tmp_path, content, message):
    path = tmp_path / "bad.obj"
    path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        load_mesh(path)
    assert len(str(caught.value)) < 300


def test_a_face_with_a_corner_twice_is_kept(tmp_path):
    (tmp_path / "a.obj").write_text(TRIANGLE + "f 1 2 2\nf 1 2 3\n")
    np.testing.assert_array_equal(load_mesh(tmp_path / "a.obj").faces, [[0, 1, 1], [0, 1, 2]])


def test_many_materials_and_libraries_are_read_in_no_time(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl m0\n" * 1000)
    uses = "".join(f"usemtl m{i}\nf 1 2 3\n" for i in range(20_000))
    (tmp_path / "a.obj").write_text(TRIANGLE + "mtllib m.mtl\n" * 1000 + uses)
    surface = load_mesh(tmp_path / "a.obj").surface
    assert len(surface.materials) == 20_000
    assert len(surface.mtl) == 10_000  # one library, named a thousand times


def glb(path, header, buffer=b""):
    """A GLB file of a header, a mapping or the very text."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def scene(**changes):
    """The header of a scene with one triangle, 36 bytes of positions."""
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    return header | changes


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
ACCESSOR = {"componentType": 5126, "count": 3, "type": "VEC3"}


def test_a_written_scene_is_read(tmp_path):
    assert load_mesh(glb(tmp_path / "a.glb", scene(), CORNERS)).vertices.tolist()[1] == [1, 0, 0]


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (scene(accessors=[ACCESSOR | {"count": 10**12}]), "accessor 0 counts 1000000000000 values"),
        (scene(accessors=[ACCESSOR | {"count": -3}]), "accessor 0 counts -3 values"),
        (scene(nodes=[{"mesh": 0, "children": [0]}]), "hangs from itself"),
        (scene(nodes=[{"children": [1]}, {"children": [0]}]), "hangs from itself"),
        (scene(nodes=[{"children": [9]}]), "node 9 hangs from two others, or does not exist"),
        (scene(nodes=[{"mesh": 0}] * 10**5, meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * 500}]),
         "150000000 vertices and corners"),
        (scene(meshes=[{"primitives": [{"attributes": {"POSITION": 7}}]}]), "not that of a GLB"),
        (scene(nodes=[{"mesh": 5}]), "not that of a GLB"),
        (b"[" * 10**5, "not that of a GLB"),
        (b"[1, 2]", "not that of a GLB"),
        (b"\xff\xfe", "not that of a GLB"),
        (scene(nodes=[{"mesh": 0, "scale": [1e300, 1, 1]}]), "beyond"),
        (scene(buffers=[{"byteLength": 36, "uri": "other.bin"}]), "cannot be read"),
    ],
)  # fmt: skip
def test_glb_headers_that_cannot_be_meant(tmp_path, header, message):
    (tmp_path / "other.bin").write_bytes(CORNERS)
    with pytest.raises(InputError, match=rf"bad\.glb: .*{message}"):
        load_mesh(glb(tmp_path / "bad.glb", header, CORNERS))


@pytest.mark.parametrize("count", ["3000000000", "-1", "many", "9" * 5000])
@pytest.mark.parametrize("element", ["vertex 8", "face 12"])
@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_ply_headers_that_count_too_much(tmp_path, element, count, encoding):
    whole = trimesh.creation.box().export(file_type="ply", encoding=encoding)
    wanted, path = element.encode(), tmp_path / "bad.ply"
    assert wanted in whole
    path.write_bytes(whole.replace(wanted, element.split()[0].encode() + b" " + count.encode(), 1))
    with pytest.raises(InputError, match=r"bad\.ply"):
        load_mesh(path)


def test_a_pipe_is_no_mesh(tmp_path):
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(InputError, match="a pipe or a device"):
        load_mesh(tmp_path / "pipe.obj")
