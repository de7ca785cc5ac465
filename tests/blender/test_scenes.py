"""Alembic and USD files that Blender's own exporters wrote, with their options, read back as Blender has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.sequences import open_in_metres
from render import MeshSequence, Option
from tests.blender.blender_python import run_blender

pytestmark = pytest.mark.long

ABC = ("plain.abc", "flat.abc", "triangles.abc", "centimetres.abc", "cages.abc", "instances.abc")
USD = (
    *("plain.usdc", "text.usda", "packed.usdz", "y_up.usdc", "centimetres.usd", "points.usdc", "merged.usdc"),
    "triangles.usdc",
)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of `write_scenes`."""
    folder = tmp_path_factory.mktemp("scenes")
    run_blender(Path(__file__).with_name("write_scenes.py"), folder)
    return folder


def read(path: Path, name: str) -> MeshSequence:
    """An object in metres, y up."""
    scale = 0.01 if path.name == "centimetres.abc" else 1.0  # the one thing that no Alembic file says
    axes = Axes(scale=scale, given=frozenset({"scale"}) if scale != 1 else frozenset())
    return open_in_metres(path, "garment", axes, which=Option("garment_object", name)).sequence


@pytest.mark.parametrize("name", [*ABC, *USD])
@pytest.mark.parametrize("thing", ["cloth", "body", "mirrored"])
def test_blender_s_meshes_are_where_blender_has_them(name: str, thing: str, scenes: Path) -> None:
    sequence = read(scenes / name, thing)
    with np.load(scenes / "truth.npz") as file:
        truth = dict(file)
    x, y, z = np.moveaxis(truth[thing], -1, 0)
    want = np.stack([x, z, -y], axis=-1)
    still = sequence.n_frames == 1 and thing == "mirrored"
    assert sequence.fps == (None if still else 25)
    np.testing.assert_allclose(sequence.vertices(), want[:1] if still else want, rtol=0, atol=2e-6)


@pytest.mark.parametrize("name", [*ABC, *USD])
def test_blender_s_polygons_keep_their_order_their_corners_and_their_side(name: str, scenes: Path) -> None:
    sequence = read(scenes / name, "cloth")
    with np.load(scenes / "truth.npz") as file:
        truth = dict(file)
    quads, surface = truth["quads"], sequence.mesh.surface
    fans = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    if name.startswith("triangles"):  # in an order of Blender's own
        turned = {tuple(np.roll(face, turn)) for face in fans for turn in range(3)}
        turned |= {tuple(np.roll(quad[[0, 1, 3]], turn)) for quad in quads for turn in range(3)}
        turned |= {tuple(np.roll(quad[[1, 2, 3]], turn)) for quad in quads for turn in range(3)}
        assert {tuple(face) for face in sequence.faces} <= turned
        assert len({frozenset(face) for face in sequence.faces.tolist()}) == len(fans)
        return
    np.testing.assert_array_equal(sequence.faces, fans)
    assert surface is not None
    assert surface.uvs is not None
    assert surface.uv_faces is not None
    uvs = {
        (face, vertex): uv
        for face, (corners, values) in enumerate(zip(quads.tolist(), truth["uvs"], strict=True))
        for vertex, uv in zip(corners, values, strict=True)
    }
    for number, (face, corners) in enumerate(zip(sequence.faces, surface.uv_faces, strict=True)):
        for vertex, corner in zip(face.tolist(), corners.tolist(), strict=True):
            np.testing.assert_allclose(surface.uvs[corner], uvs[number // 2, vertex], rtol=0, atol=1e-6)
    if name.endswith(".abc") and name not in ("plain.abc", "instances.abc"):
        assert surface.materials == ()  # face sets are an option
        return
    assert surface.materials == ("red", "blue")
    assert surface.face_materials is not None
    assert surface.face_materials.tolist() == np.repeat(truth["materials"], 2).tolist()


@pytest.mark.parametrize("name", [*ABC, *USD])
def test_blender_s_mirrored_objects_face_outwards(name: str, scenes: Path) -> None:
    sequence = read(scenes / name, "mirrored")
    points = sequence.vertices()[0].astype(np.float64)
    corners = points[sequence.faces]
    middles, axis = corners.mean(axis=1), points.mean(axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = (middles - axis) * [1, 0, 1]  # y is along the tube
    assert ((normals * outwards).sum(axis=1) > 0).all()
