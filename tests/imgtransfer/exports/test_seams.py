"""Texture seams and materials for glTF: cut by hand, and whatever an MTL library holds."""

import numpy as np
import pytest

from imgtransfer.exports.gltf import gltf_material
from imgtransfer.exports.materials import IMAGES, material_of
from imgtransfer.exports.seams import cut_at_seams
from render.mesh.surface import Surface
from render.pictures import write_png

GREY = (0.5, 0.5, 0.5, 1.0)
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UVS = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.25, 0.75]], np.float32)


def surface(uv_faces, uvs=UVS, faces=FACES):
    return Surface(
        vertices=np.arange(10, 14),
        faces=faces,
        uvs=uvs,
        uv_faces=None if uv_faces is None else np.array(uv_faces),
    )


def test_a_mesh_without_coordinates_is_not_cut():
    cut = cut_at_seams(surface(None, None))
    assert cut.uvs is None
    assert cut.vertices.tolist() == [10, 11, 12, 13]
    assert np.array_equal(cut.faces, FACES)


def test_one_coordinate_a_vertex_needs_no_cut_and_v_goes_down():
    cut = cut_at_seams(surface([[0, 1, 2], [0, 2, 3]]))
    assert cut.vertices.tolist() == [10, 11, 12, 13]
    assert np.array_equal(cut.faces, FACES)
    assert cut.uvs.dtype == np.float32
    assert cut.uvs.tolist() == [[0, 1], [1, 1], [1, 0], [0, 0]]


def test_a_vertex_on_a_seam_gets_a_copy_behind_all_others():
    cut = cut_at_seams(surface([[0, 1, 2], [4, 2, 3]]))  # the first vertex has two coordinates
    assert cut.vertices.tolist() == [10, 11, 12, 13, 10]
    assert cut.faces.tolist() == [[0, 1, 2], [4, 2, 3]]
    assert cut.uvs[[0, 4]].tolist() == [[0, 1], [0.25, 0.25]]


def test_every_corner_keeps_its_vertex_and_its_coordinate():
    random = np.random.default_rng(0)
    faces = np.array([random.choice(12, 3, replace=False) for _ in range(30)])
    uv_faces, uvs = random.integers(-1, 9, (30, 3)), random.random((9, 2)).astype(np.float32)
    given = Surface(vertices=np.arange(12) * 2, faces=faces, uvs=uvs, uv_faces=uv_faces)
    cut = cut_at_seams(given)
    assert cut.vertices[:12].tolist() == given.vertices.tolist()
    for face, corner in np.ndindex(30, 3):
        at = cut.faces[face, corner]
        assert cut.vertices[at] == given.vertices[faces[face, corner]]
        number = uv_faces[face, corner]
        wanted = [0, 0] if number < 0 else [uvs[number, 0], 1 - uvs[number, 1]]  # -1: a corner without one
        assert cut.uvs[at] == pytest.approx(wanted)
    assert len(cut.vertices) == max(12, cut.faces.max() + 1)


MTL = """
newmtl red
Kd 1 0 0
d 0.25
newmtl red velvet
 Kd 0.5 0 0.1
newmtl glass
Tr 0.75
Kd 0 1
newmtl light
Kd 0.5
newmtl plain
"""


@pytest.mark.parametrize(("name", "colour"), [
    ("red", [1, 0, 0, 0.25]),
    ("red velvet", [0.5, 0, 0.1, 1]),  # another name that begins alike
    ("plain", GREY),
    ("light", [0.5, 0.5, 0.5, 1]),  # one number is all three
    ("absent", GREY),
    ("re.", GREY),  # a name is no pattern
])  # fmt: skip
def test_colours_of_materials(name, colour):
    found = material_of(name, MTL)
    described = gltf_material(found, GREY)
    assert found.image is None
    assert described["name"] == name
    assert described["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx(list(colour))
    assert described.get("alphaMode") == ("BLEND" if colour[3] < 1 else None)


def test_transparency_is_opacitys_opposite():
    assert gltf_material(material_of("glass", MTL), GREY)["alphaMode"] == "BLEND"


@pytest.mark.parametrize("line", ["Kd", "Kd x y z", "Kd 1 two 3"])
def test_colours_that_are_none_leave_the_default(line):
    described = gltf_material(material_of("a", f"newmtl a\n{line}\n"), GREY)
    assert described["pbrMetallicRoughness"]["baseColorFactor"] == list(GREY)


@pytest.mark.parametrize(
    ("suffix", "kind"),
    [("png", "image/png"), ("PNG", "image/png"), ("jpg", "image/jpeg"), ("jpeg", "image/jpeg")],
)
def test_an_image_takes_the_place_of_the_colour(tmp_path, suffix, kind):
    picture = tmp_path / "cloth.png"
    write_png(picture, np.zeros((2, 2, 3), np.uint8))
    path = picture.rename(tmp_path / f"cloth.{suffix}")
    found = material_of("a", f"newmtl a\nKd 1 0 0\nd 0.5\nmap_Kd {path}\n")
    described = gltf_material(found, GREY)
    assert found.image == path
    assert IMAGES[path.suffix.lower()] == kind
    assert described["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 0.5]


@pytest.mark.parametrize("content", [None, b"no picture"])
def test_an_image_that_is_missing_or_none_leaves_the_colour(tmp_path, content):
    path = tmp_path / "cloth.png"
    if content is not None:
        path.write_bytes(content)
    found = material_of("a", f"newmtl a\nKd 1 0 0\nmap_Kd {path}\n")
    described = gltf_material(found, GREY)
    assert found.image is None
    assert described["pbrMetallicRoughness"]["baseColorFactor"] == [1, 0, 0, 1]
