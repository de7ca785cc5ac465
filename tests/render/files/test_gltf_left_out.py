"""glTF beyond still triangles: poses, and what is not read, which is said or refused and never silent."""

from __future__ import annotations

import numpy as np
import pytest

from imgtransfer.importers.summary import size_text
from render import InputError, Mesh, load_mesh
from tests.helpers.gltf_files import TRIANGLE, GlbWriter

HALF = np.sqrt(0.5)
TURNED = [[0, 0, 0], [0, 1, 0], [-1, 0, 0]]  # the triangle, x to y


def read(writer: GlbWriter, tmp_path) -> Mesh:
    return load_mesh(writer.write(tmp_path / "a.glb"))


def triangle(**more: object) -> tuple[GlbWriter, dict]:
    """A file with one triangle, and the primitive of its mesh."""
    writer = GlbWriter()
    primitive = {"attributes": {"POSITION": writer.array(TRIANGLE, "f4")}}
    writer.mesh(primitive, **more)
    return writer, primitive


def test_nothing_is_left_out_of_a_plain_file(tmp_path):
    mesh = read(triangle()[0], tmp_path)
    assert mesh.left_out == ()
    assert size_text(mesh) == "1.00 m high, 1.00 m wide, 0.00 m deep"


def skinned(joint: dict, *, bind: np.ndarray | None = None) -> GlbWriter:
    """The triangle on two joints, half and half: node 1, still at the origin, and node 2. Its own node is elsewhere."""
    writer, primitive = triangle()
    primitive["attributes"] |= {
        "JOINTS_0": writer.array([[0, 1, 0, 0]] * 3, "u1"),
        "WEIGHTS_0": writer.array([[0.5, 0.5, 0, 0]] * 3, "f4"),
    }
    skin: dict = {"joints": [1, 2]}
    if bind is not None:
        stored = [np.eye(4).T.ravel(), bind.T.ravel()]  # by columns
        skin["inverseBindMatrices"] = writer.array(stored, "f4")
    writer.header |= {
        "nodes": [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {}, joint],
        "scenes": [{"nodes": [0, 1, 2]}],
        "skins": [skin],
    }
    return writer


def test_a_skinned_mesh_stands_as_its_joints_do_and_not_as_its_node(tmp_path):
    mesh = read(skinned({"translation": [0, 2, 0]}), tmp_path)
    np.testing.assert_allclose(mesh.vertices, np.add(TRIANGLE, [0, 1, 0]))
    assert mesh.left_out == ("the skin's joints: its mesh stands as they do in the file",)
    assert "not taken: the skin's joints" in size_text(mesh)


def test_at_bind_a_skinned_mesh_is_as_it_is_stored(tmp_path):
    place = np.array([[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])
    joint = {"translation": [5, 6, 7], "rotation": [0, 0, HALF, HALF]}
    mesh = read(skinned(joint, bind=np.linalg.inv(place)), tmp_path)
    np.testing.assert_allclose(mesh.vertices, TRIANGLE, atol=1e-6)


def test_a_vertex_of_no_joint_is_of_the_first_and_too_small_weights_are_made_to_sum_to_one(tmp_path):
    writer = skinned({"translation": [0, 2, 0]})
    writer.header["meshes"][0]["primitives"][0]["attributes"] |= {
        "JOINTS_0": writer.array([[1, 0, 0, 0]] * 3, "u2"),
        "WEIGHTS_0": writer.array([[0, 0, 0, 0], [128, 0, 0, 0], [255, 0, 0, 0]], "u1", normalized=True),
    }
    np.testing.assert_allclose(read(writer, tmp_path).vertices, np.add(TRIANGLE, [0, 2, 0]))


def test_a_joint_that_mirrors_turns_the_triangles_round(tmp_path):
    writer = skinned({"scale": [-1, 1, 1]})
    writer.header["nodes"][1] = {"scale": [-1, 1, 1]}
    mesh = read(writer, tmp_path)
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joints": [1]}, "accessor 1 holds 1, of 1 that there are"),
        ({"joints": [1, 9]}, "cannot be read"),
        ({"inverseBindMatrices": 0}, "is VEC3, not MAT4"),
    ],
)
def test_a_skin_that_does_not_fit_is_refused(tmp_path, changes, message):
    writer = skinned({})
    writer.header["skins"][0] |= changes
    with pytest.raises(InputError, match=message):
        read(writer, tmp_path)


def test_fewer_bind_matrices_than_joints_are_refused(tmp_path):
    writer = skinned({})
    writer.header["skins"][0]["inverseBindMatrices"] = writer.array([np.eye(4).ravel()], "f4")
    with pytest.raises(InputError, match="cannot be read"):
        read(writer, tmp_path)


@pytest.mark.parametrize("of_node", [False, True])
def test_morph_targets_have_the_weights_of_the_node_or_else_of_the_mesh(tmp_path, of_node):
    writer, primitive = triangle(weights=[0.5, 0])
    primitive["targets"] = [
        {"POSITION": writer.array([[0, 0, 4]] * 3, "f4")},
        {"POSITION": writer.array([[0, 0, 1]] * 3, "f4")},
    ]
    if of_node:
        writer.header["nodes"][0]["weights"] = [0, 3]
    mesh = read(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, np.add(TRIANGLE, [0, 0, 3 if of_node else 2]))
    assert mesh.left_out == ("morph targets: their weights are those of the file",)


def test_the_same_places_moved_by_other_targets_are_other_vertices(tmp_path):
    writer, plain = triangle(weights=[1])
    moved = plain | {"targets": [{"POSITION": writer.array([[0, 0, 4]] * 3, "f4")}]}
    writer.mesh(plain, moved, weights=[1])
    mesh = read(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, [*TRIANGLE, *np.add(TRIANGLE, [0, 0, 4])])
    assert mesh.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def test_animations_are_named(tmp_path):
    writer, _ = triangle()
    animation = {"channels": [], "samplers": []}
    writer.header["animations"] = [animation | {"name": "Walk"}, animation]
    assert read(writer, tmp_path).left_out == ("animations (Walk, 1): one still frame is read",)


def test_points_and_lines_are_counted_and_alone_are_no_mesh(tmp_path):
    writer, primitive = triangle()
    loose = [primitive | {"mode": 0}, primitive | {"mode": 3}]
    writer.mesh(primitive, *loose)
    assert read(writer, tmp_path).left_out == ("2 primitives of points or lines",)
    writer.mesh(*loose)
    with pytest.raises(InputError, match="no faces"):
        read(writer, tmp_path)


def test_the_scene_that_the_file_names_is_read_and_what_is_in_others_counted(tmp_path):
    writer, _ = triangle()
    writer.header |= {
        "nodes": [{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}],
        "scenes": [{"nodes": [0]}, {"nodes": [1]}],
        "scene": 1,
    }
    mesh = read(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, np.add(TRIANGLE, [5, 0, 0]))
    assert mesh.left_out == ("1 meshes that are not in the scene",)


def test_a_mesh_of_two_nodes_is_two_copies_with_their_own_looks(tmp_path):
    writer, primitive = triangle()
    primitive["attributes"]["TEXCOORD_0"] = writer.array([[0, 0], [1, 0], [0, 1]], "f4")
    primitive["material"] = 0
    writer.header |= {
        "nodes": [{"mesh": 0}, {"mesh": 0, "scale": [-1, 1, 1], "rotation": [0, 0, HALF, HALF]}],
        "scenes": [{"nodes": [1, 0]}],
        "materials": [{"name": "cloth"}],
    }
    mesh = read(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices[3:], [[0, 0, 0], [0, -1, 0], [-1, 0, 0]], atol=1e-7)
    assert mesh.faces.tolist() == [[0, 1, 2], [5, 4, 3]]
    assert mesh.surface.uvs[mesh.surface.uv_faces[1]].tolist() == [[0, 0], [1, 1], [0, 1]]
    assert mesh.surface.face_materials.tolist() == [0, 0]


def textured(image: dict, **texture: object) -> GlbWriter:
    writer, primitive = triangle()
    primitive["attributes"]["TEXCOORD_0"] = writer.array([[0, 0], [1, 0], [0, 1]], "f4")
    primitive["material"] = 0
    reference = {"index": 0} | texture
    writer.header |= {
        "materials": [{"name": "cloth", "pbrMetallicRoughness": {"baseColorTexture": reference}}],
        "textures": [{"source": 0}],
        "images": [image],
    }
    return writer


@pytest.mark.parametrize(
    ("image", "name"),
    [
        ({"name": "weave", "mimeType": "image/png", "bufferView": 0}, "weave.png"),
        ({"name": "../up/weave.jpg", "mimeType": "image/jpeg", "bufferView": 0}, "weave.jpg"),
        ({"mimeType": "image/jpeg", "bufferView": 0}, "image_0.jpg"),
        ({"uri": "data:image/webp;base64,AAAA"}, "image_0.webp"),
    ],
)
def test_an_image_inside_the_file_is_named_and_taken_once_it_lies_beside_it(tmp_path, image, name):
    mesh = read(textured(image), tmp_path)
    assert mesh.left_out == (f"images inside the file (to have {name} come along, put it beside the file)",)
    assert mesh.surface.mtl.endswith(f"map_Kd {name}\n")
    (tmp_path / name).write_bytes(b"image")
    assert read(textured(image), tmp_path).surface.mtl.endswith(f"map_Kd {(tmp_path / name).resolve()}\n")


def test_an_image_that_an_extension_names_is_found(tmp_path):
    writer = textured({"uri": "weave.webp"})
    writer.header["textures"] = [{"extensions": {"EXT_texture_webp": {"source": 0}}}]
    assert "map_Kd weave.webp\n" in read(writer, tmp_path).surface.mtl


def test_texture_transforms_that_the_file_can_do_without_are_named(tmp_path):
    shifted = {"KHR_texture_transform": {"offset": [0.5, 0]}}
    writer = textured({"uri": "weave.png"}, extensions=shifted)
    writer.header["extensionsUsed"] = ["KHR_texture_transform"]
    mesh = read(writer, tmp_path)
    assert mesh.left_out == ("texture transforms",)
    assert mesh.surface.uvs.tolist() == [[0, 1], [1, 1], [0, 0]]


def test_textures_of_other_things_than_colour_are_named(tmp_path):
    writer = textured({"uri": "weave.png"})
    writer.header["materials"][0]["normalTexture"] = {"index": 0}
    writer.header["materials"][0]["pbrMetallicRoughness"]["metallicRoughnessTexture"] = {"index": 0}
    assert read(writer, tmp_path).left_out == ("textures of normals, roughness",)


def test_places_in_small_whole_numbers_are_read_where_nothing_is_required(tmp_path):
    writer = GlbWriter()
    places = writer.array([[0, 0, 0, 0], [32767, 0, 0, 0], [0, -32768, 0, 0]], "i2", normalized=True)
    writer.header["accessors"][places] |= {"type": "VEC3"}
    writer.header["bufferViews"][places]["byteStride"] = 8
    writer.mesh({"attributes": {"POSITION": places}})
    writer.header["nodes"] = [{"mesh": 0, "scale": [2, 2, 2]}]
    writer.header["extensionsUsed"] = ["KHR_mesh_quantization"]
    assert read(writer, tmp_path).vertices.tolist() == [[0, 0, 0], [2, 0, 0], [0, -2, 0]]


@pytest.mark.parametrize("plain", [True, False])
@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
def test_the_plain_copy_of_packed_data_is_read_and_a_lacking_one_refused(tmp_path, name, plain):
    writer, _ = triangle()
    packed = {
        "buffer": 1,
        "byteOffset": 0,
        "byteLength": 4,
        "byteStride": 12,
        "count": 3,
        "mode": "ATTRIBUTES",
    }
    writer.header["bufferViews"][0]["extensions"] = {name: packed}
    writer.header["extensionsUsed"] = [name]
    size = len(writer.binary)
    writer.header["buffers"] = [{"byteLength": size}, {"byteLength": 4, "uri": "data:;base64,AAAAAA=="}]
    if plain:
        assert read(writer, tmp_path).vertices.tolist() == TRIANGLE.tolist()
        return
    writer.header["buffers"][0]["extensions"] = {name: {"fallback": True}}
    with pytest.raises(InputError, match=f"only as {name} packs them"):
        read(writer, tmp_path)


@pytest.mark.parametrize("plain", [True, False])
def test_a_mesh_beside_its_draco_form_is_read_and_a_lacking_one_refused(tmp_path, plain):
    writer, primitive = triangle()
    primitive["extensions"] = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    writer.header["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    if plain:
        assert read(writer, tmp_path).vertices.tolist() == TRIANGLE.tolist()
        return
    del writer.header["accessors"][0]["bufferView"]
    with pytest.raises(InputError, match=r"no data here .*KHR_draco_mesh_compression"):
        read(writer, tmp_path)


def test_a_second_buffer_without_a_place_is_not_the_first(tmp_path):
    writer, _ = triangle()
    writer.header["bufferViews"][0]["buffer"] = 1
    writer.header["buffers"] = [{"byteLength": 36}, {"byteLength": 36}]
    with pytest.raises(InputError, match="a buffer of 36 bytes has only 0"):
        read(writer, tmp_path)


def test_sparse_places_are_refused_and_never_zeros(tmp_path):
    writer = GlbWriter()
    indices, values = writer.array([1, 2], "u2"), writer.array(TRIANGLE[1:], "f4")
    sparse = {
        "count": 2,
        "indices": {"bufferView": indices, "componentType": 5123},
        "values": {"bufferView": values},
    }
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}
    writer.header["accessors"].append(accessor)
    writer.mesh({"attributes": {"POSITION": 2}})
    with pytest.raises(InputError, match="accessor 2 is sparse, which is not read"):
        read(writer, tmp_path)


@pytest.mark.parametrize(("kind", "values"), [("f4", [0, 1, 2]), ("i2", [0, 1, -1])])
def test_indices_of_another_kind_are_refused(tmp_path, kind, values):
    writer, primitive = triangle()
    primitive["indices"] = writer.array(values, kind)
    with pytest.raises(InputError, match="unsigned whole numbers"):
        read(writer, tmp_path)


def test_a_turned_node_without_a_surface(tmp_path):
    writer, _ = triangle()
    writer.header["nodes"][0]["rotation"] = [0, 0, HALF, HALF]
    mesh = read(writer, tmp_path)
    np.testing.assert_allclose(mesh.vertices, TURNED, atol=1e-7)
    assert mesh.surface is None
