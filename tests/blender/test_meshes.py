"""What Blender's exporters write, read back: places to 1e-6, faces, corner texture coordinates and materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from render import InputError, Mesh, load_mesh

pytestmark = pytest.mark.long

Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])  # (x, y, z) of Blender is (x, z, -y)
Z_UP = np.eye(3)


def truth(folder: Path) -> dict[str, np.ndarray]:
    with np.load(folder / "truth.npz") as stored:
        return dict(stored)


def corners(mesh: Mesh) -> dict[tuple[float, ...], set[tuple[float, ...]]]:
    """Of each place, rounded, the texture coordinates and materials of its corners."""
    surface = mesh.surface
    result: dict[tuple[float, ...], set[tuple[float, ...]]] = {}
    for number, face in enumerate(mesh.faces):
        for corner, vertex in enumerate(face):
            look: tuple[object, ...] = ()
            if surface is not None and surface.uvs is not None:
                look += tuple((surface.uvs[surface.uv_faces[number, corner]] + 10).round(5).tolist())
            if surface is not None and surface.face_materials is not None:
                look += (surface.materials[surface.face_materials[number]],)
            place = tuple((mesh.vertices[vertex] + 10).round(5).tolist())
            result.setdefault(place, set()).add(look)
    return result


def wanted(folder: Path, axes: np.ndarray, *, uvs: bool, materials: bool) -> dict:
    stored, result = truth(folder), {}
    places = (stored["vertices"] @ axes.T + 10).round(5)
    for quad, corner_uvs, material in zip(stored["quads"], stored["uvs"], stored["materials"], strict=True):
        for vertex, uv in zip(quad, corner_uvs, strict=True):
            look = tuple((uv.astype(np.float32) + 10).round(5).tolist()) if uvs else ()
            look += (str(stored["names"][material]),) if materials else ()
            result.setdefault(tuple(places[vertex].tolist()), set()).add(look)
    return result


@pytest.mark.parametrize(
    ("name", "axes", "uvs", "materials"),
    [
        ("quads.obj", Y_UP, True, True),
        ("triangles.obj", Y_UP, True, True),
        ("z_up.obj", Z_UP, True, True),
        ("bare.obj", Y_UP, False, False),
        ("binary.ply", Z_UP, True, False),
        ("ascii.ply", Z_UP, True, False),
        ("triangles.ply", Z_UP, False, False),
        ("y_up.ply", Y_UP, False, False),
        ("tube.glb", Y_UP, True, True),
        ("z_up.glb", Z_UP, True, True),
        ("shared.glb", Y_UP, True, True),
        ("tube.gltf", Y_UP, True, True),
    ],
)
def test_places_corners_and_materials(
    exports: Path, name: str, axes: np.ndarray, uvs: bool, materials: bool
) -> None:
    mesh = load_mesh(exports / name)
    stored = truth(exports)
    assert len(mesh.faces) == 2 * len(stored["quads"])
    places = stored["vertices"] @ axes.T
    nearest = np.abs(mesh.vertices[:, None] - places).max(axis=-1)
    assert nearest.min(axis=1).max() < 1e-6
    assert nearest.min(axis=0).max() < 1e-6
    if name.endswith(".obj") or not uvs:  # Blender splits the vertices of the others at seams
        np.testing.assert_allclose(mesh.vertices, places, atol=1e-6)
    read, expected = corners(mesh), wanted(exports, axes, uvs=uvs, materials=materials)
    if name.endswith(".obj"):  # whose exporter writes blanks in names so
        expected = {place: {_underscored(look) for look in looks} for place, looks in expected.items()}
    assert len(read) == len(expected)
    assert sorted(map(sorted, read.values())) == sorted(map(sorted, expected.values()))


def _underscored(look: tuple) -> tuple:
    return tuple(part.replace(" ", "_") if isinstance(part, str) else part for part in look)


@pytest.mark.parametrize("name", ["quads.obj", "z_up.obj", "bare.obj"])
def test_quads_become_fans_in_their_order(exports: Path, name: str) -> None:
    stored, mesh = truth(exports), load_mesh(exports / name)
    by_material = np.argsort(stored["materials"], kind="stable") if name != "bare.obj" else np.arange(14)
    quads = stored["quads"][by_material]
    if not np.array_equal(mesh.faces[::2], quads[:, :3]):
        quads = stored["quads"]
    np.testing.assert_array_equal(mesh.faces[::2], quads[:, [0, 1, 2]])
    np.testing.assert_array_equal(mesh.faces[1::2], quads[:, [0, 2, 3]])


def test_a_subdivided_mesh_and_several_objects(exports: Path) -> None:
    assert len(load_mesh(exports / "subdivided.obj").faces) == 2 * 4 * 14
    everything = load_mesh(exports / "all_objects.obj")
    assert len(everything.vertices) == 21 + 8
    assert len(everything.faces) == 28 + 12


def test_compression_is_refused_by_its_name(exports: Path) -> None:
    with pytest.raises(InputError, match="KHR_draco_mesh_compression"):
        load_mesh(exports / "draco.glb")
