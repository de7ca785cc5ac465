"""Files of kinds that users of neighbouring tools have complained about, with what is right for each."""

from __future__ import annotations

import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.mesh_output import save_mesh_frames
from imgtransfer.exports.gltf import animated_glb
from render import Mesh, load_mesh
from tests.helpers.paths import ROOT

CASES = ROOT / "tests" / "data" / "cases"


def corner_uvs(mesh: Mesh) -> list:
    return mesh.surface.uvs[mesh.surface.uv_faces].tolist()


def test_a_binary_ply_of_triangles_and_quads():
    mesh = load_mesh(CASES / "triquad.ply")
    assert mesh.vertices.shape == (5, 3)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4]]


def test_texture_coordinates_without_a_material():
    mesh = load_mesh(CASES / "no_material.glb")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    a, b, c, d = [0, 0.75], [1, 0.75], [1, 0.25], [0, 0.25]
    assert corner_uvs(mesh) == [[a, b, c], [a, c, d]]


def test_two_materials_keep_their_names_and_coordinates_in_every_output(tmp_path):
    mesh = load_mesh(CASES / "two_materials.glb")
    assert mesh.surface.materials == ("red", "blue")
    assert mesh.surface.face_materials.tolist() == [0, 1]
    save_mesh_frames(tmp_path / "frames", mesh.vertices[None], mesh, "obj")
    vertices = mesh.vertices.astype(np.float32)
    clip = Clip(
        template=Template(vertices, mesh.faces, surface=mesh.surface),
        garment=Garment(vertices[None]),
        body=Body(rest=vertices, faces=mesh.faces, vertices=vertices[None]),
        fps=30.0,
        skeleton=None,
        name="a",
    )
    for written in (tmp_path / "frames/frame_0000.obj", animated_glb(tmp_path / "a.glb", clip)):
        back = load_mesh(written)
        surface = back.surface
        named = [surface.materials[number] for number in surface.face_materials]
        assert named[-2:] == ["red", "blue"]
        np.testing.assert_allclose(corner_uvs(back)[-2:], corner_uvs(mesh), atol=1e-6)
        for name, colour in (("red", "Kd 1 0 0"), ("blue", "Kd 0 0 1")):
            assert f"newmtl {name}\n{colour}\n" in surface.mtl


def test_a_texture_that_is_absent_is_passed_over_quietly(capfd):
    mesh = load_mesh(CASES / "tex.ply")
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("name", "count"), [("vertex_first", 3), ("loose_vertex", 4), ("mtllib_first", 3)])
def test_a_mark_at_the_start_of_an_obj(name, count):
    mesh = load_mesh(CASES / f"bom_{name}.obj")
    assert len(mesh.vertices) == count
    assert mesh.faces.tolist() == [[0, 1, 2]]
    if name == "mtllib_first":
        assert mesh.surface.mtl == "newmtl red\nKd 1 0 0\n"


def test_materials_of_as_many_bytes_that_are_not_utf_8():
    surface = load_mesh(CASES / "gbk" / "s.obj").surface
    assert len(set(surface.materials)) == 2
    assert surface.face_materials.tolist() == [0, 1]


@pytest.mark.parametrize(
    "named",
    [
        "TextureFile none.png",
        "TextureFile C:\\looks\\none.png",
        "TextureFile a folder.png",
        "TextureFile damaged.png",
    ],
)
@pytest.mark.parametrize("per", ["vertex", "corner"])
def test_textures_that_cannot_be_used_leave_the_mesh_and_stderr_as_they_are(tmp_path, capfd, named, per):
    (tmp_path / "a folder.png").mkdir()
    (tmp_path / "damaged.png").write_bytes(b"no picture")
    head = ["ply", "format ascii 1.0", f"comment {named}", "element vertex 3"]
    head += [f"property float {axis}" for axis in ("xyz" if per == "corner" else "xyzst")]
    head += ["element face 1", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] if per == "corner" else []
    uvs = [".25 .5", "1 0", "0 1"]
    places = ["0 0 0", "1 0 0", "0 1 0"]
    rows = places if per == "corner" else [f"{place} {uv}" for place, uv in zip(places, uvs, strict=True)]
    face = "3 0 1 2" + (f" 6 {' '.join(uvs)}" if per == "corner" else "")
    (tmp_path / "a.ply").write_text("\n".join([*head, "end_header", *rows, face, ""]))
    mesh = load_mesh(tmp_path / "a.ply")
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert corner_uvs(mesh) == [[[0.25, 0.5], [1, 0], [0, 1]]]
    assert len(mesh.surface.materials) == 1
    assert capfd.readouterr() == ("", "")
