"""glTF of other programs, with the values by hand: what is kept, and what is refused by its name."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path

import numpy as np
import pytest

from render import InputError, load_mesh

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
PLACES = CORNERS.tolist()


def header(**changes: object) -> dict:
    """One triangle at the buffer's start, 36 bytes."""
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    } | changes


def glb(tmp_path: Path, described: dict, binary: bytes = CORNERS.tobytes()):
    text = json.dumps(described).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return load_mesh(tmp_path / "a.glb")


def test_nodes_in_the_files_order_placed_by_all_above_them(tmp_path):
    half = np.sqrt(0.5)
    nodes = [
        {"mesh": 0, "translation": [0, 0, 1]},
        {"mesh": 0, "matrix": [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 5, 6, 7, 1]},
        {"children": [0], "rotation": [0, 0, half, half], "scale": [2, 2, 2]},  # x to y
        {"mesh": 0},  # of no scene
    ]
    mesh = glb(tmp_path, header(nodes=nodes, scenes=[{"nodes": [2, 1]}]))
    np.testing.assert_allclose(mesh.vertices[:3], [[0, 0, 2], [0, 2, 2], [-2, 0, 2]], atol=1e-12)
    np.testing.assert_allclose(mesh.vertices[3:], [[5, 6, 7], [7, 6, 7], [5, 8, 7]])
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_a_mirrored_node_turns_its_triangles_round(tmp_path):
    mesh = glb(tmp_path, header(nodes=[{"mesh": 0, "scale": [-1, 1, 1]}]))
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0


@pytest.mark.parametrize(("mode", "faces"), [(5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])])
def test_strips_and_fans(tmp_path, mode, faces):
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4").tobytes()
    described = header(
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}],
        accessors=[{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        bufferViews=[{"buffer": 0, "byteLength": 48}],
        buffers=[{"byteLength": 48}],
    )
    assert glb(tmp_path, described, places).faces.tolist() == faces


def test_points_and_lines_beside_triangles_are_passed_over(tmp_path):
    primitives = [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 4)]
    assert glb(tmp_path, header(meshes=[{"primitives": primitives}])).faces.tolist() == [[0, 1, 2]]


def test_materials_without_names_or_with_the_same_stay_apart_and_those_missing_are_said(tmp_path):
    primitives = [
        {"attributes": {"POSITION": 0}} | ({} if number is None else {"material": number})
        for number in (2, 0, 1, None)
    ]
    colour = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0, 0.25]}}
    materials = [{"name": "cloth"} | colour, {}, {"name": "cloth"}]
    surface = glb(tmp_path, header(meshes=[{"primitives": primitives}], materials=materials)).surface
    assert surface.uvs is None
    assert surface.materials == ("cloth", "cloth-0", "material_1", "default")
    assert surface.face_materials.tolist() == [0, 1, 2, 3]
    assert "newmtl cloth-0\nKd 1 0.5 0\nd 0.25\n" in surface.mtl


def test_an_image_beside_the_file_comes_along_and_its_own_set_of_coordinates_is_taken(tmp_path):
    (tmp_path / "my weave.png").write_bytes(b"png")
    uvs = np.array([[0, 0], [1, 0], [0.5, 0.25]], "<f4")
    described = header(
        meshes=[
            {"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2, "TEXCOORD_1": 1}, "material": 0}]}
        ],
        accessors=[
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        bufferViews=[{"buffer": 0, "byteLength": 60}],
        buffers=[{"byteLength": 60}],
        materials=[{"name": "a", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}],
        textures=[{"source": 0}],
        images=[{"uri": "my%20weave.png"}],
    )
    surface = glb(tmp_path, described, CORNERS.tobytes() + uvs.tobytes()).surface
    assert surface.uvs[surface.uv_faces].tolist() == [[[0, 1], [1, 1], [0.5, 0.75]]]
    assert f"map_Kd {(tmp_path / 'my weave.png').resolve()}\n" in surface.mtl


@pytest.mark.parametrize("where", ["beside", "inside"])
def test_gltf_with_its_buffer(tmp_path, where):
    (tmp_path / "a b.bin").write_bytes(CORNERS.tobytes())
    inside = "data:application/octet-stream;base64," + base64.b64encode(CORNERS.tobytes()).decode()
    uri = "a%20b.bin" if where == "beside" else inside
    (tmp_path / "a.gltf").write_text(json.dumps(header(buffers=[{"byteLength": 36, "uri": uri}])))
    assert load_mesh(tmp_path / "a.gltf").vertices.tolist() == PLACES


@pytest.mark.parametrize("uri", ["../other.bin", "/etc/hostname", "none.bin", "data:,x"])
def test_gltf_leads_nowhere_else(tmp_path, uri):
    (tmp_path / "in").mkdir()
    (tmp_path / "other.bin").write_bytes(CORNERS.tobytes())
    (tmp_path / "in/a.gltf").write_text(json.dumps(header(buffers=[{"byteLength": 36, "uri": uri}])))
    with pytest.raises(InputError, match="cannot be read"):
        load_mesh(tmp_path / "in/a.gltf")


@pytest.mark.parametrize(
    "name",
    ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization", "KHR_texture_transform",
     "EXT_new"],
)  # fmt: skip
def test_required_extensions_that_are_not_read_are_named(tmp_path, name):
    with pytest.raises(InputError, match=f"requires the glTF extension {name}, which is not read"):
        glb(tmp_path, header(extensionsUsed=[name], extensionsRequired=["KHR_materials_unlit", name]))
    assert glb(tmp_path, header(extensionsUsed=[name])).vertices.tolist() == PLACES


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sparse": {"count": 1}}, "sparse"),
        ({"bufferView": None}, "cannot be read"),
        ({"count": 4}, "reaches beyond"),
        ({"byteOffset": 4}, "reaches beyond"),
        ({"type": "VEC4"}, "is VEC4"),
        ({"componentType": 1}, "cannot be read"),
    ],
)
def test_data_that_are_not_there_are_never_zeros(tmp_path, changes, message):
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | changes
    with pytest.raises(InputError, match=message):
        glb(tmp_path, header(accessors=[accessor]))


def test_an_accessor_without_a_view_names_what_the_file_uses(tmp_path):
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3"}
    with pytest.raises(InputError, match=r"has no data here .*KHR_draco_mesh_compression"):
        glb(tmp_path, header(accessors=[accessor], extensionsUsed=["KHR_draco_mesh_compression"]))


def test_meshes_repeated_by_the_graphics_card_are_refused(tmp_path):
    with pytest.raises(InputError, match="EXT_mesh_gpu_instancing"):
        glb(tmp_path, header(nodes=[{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {}}}]))


def test_an_index_beyond_the_vertices_is_named(tmp_path):
    described = header(
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        accessors=[
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        bufferViews=[{"buffer": 0, "byteLength": 42}],
        buffers=[{"byteLength": 42}],
    )
    with pytest.raises(InputError, match="accessor 1 holds 3, of 3 that there are"):
        glb(tmp_path, described, CORNERS.tobytes() + np.array([0, 1, 3], "<u2").tobytes())
