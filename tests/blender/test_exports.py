"""What is exported, opened by Blender itself: vertices to 1e-5 m in five frames, axes, rate, range, names, look."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest

from imgtransfer.data.clip import Clip
from imgtransfer.exports import written_animation
from render.mesh.surface import Surface
from tests.blender.blender_python import run_blender

pytestmark = pytest.mark.long

ENDINGS = (".glb", ".usd", ".usda", ".usdz", ".abc", ".pc2", ".mdd")
FRAMES = (0, 1, 2, 4, 5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("exports")


@pytest.fixture(scope="module")
def clip(folder: Path) -> Clip:
    """A tube in motion whose file had a seam in it, two materials and a texture."""
    from tests.helpers.synthetic import tube_clip  # noqa: PLC0415

    bare = tube_clip()
    cv2.imwrite(f"{folder}/cloth.png", np.full((2, 3, 3), 200, np.uint8))
    count, faces = len(bare.template.vertices), bare.template.faces.copy()
    at = bare.template.faces[0, 0]
    faces[0][faces[0] == at] = count
    random = np.random.default_rng(0)
    surface = Surface(
        faces=faces,
        vertices=np.append(np.arange(count), at),
        uvs=random.random((7, 2)).astype(np.float32),
        uv_faces=random.integers(0, 7, faces.shape),
        face_materials=(np.arange(len(faces)) % 2).astype(np.int64),
        materials=("wool", "silk"),
        mtl=f"newmtl wool\nKd 0.5 0.25 0\nnewmtl silk\nmap_Kd {folder}/cloth.png\n",
    )
    return bare.with_surface(surface)


@pytest.fixture(scope="module")
def opened(clip: Clip, folder: Path) -> dict[str, dict[str, np.ndarray]]:
    """What Blender has of each file."""
    files = []
    for ending in ENDINGS:
        files.append(folder / ending[1:] / f"walk{ending}")
        with written_animation(files[-1], n_frames=clip.n_frames) as add:
            add(clip)
    for kind in ("obj", "ply"):
        with written_animation(folder / kind, n_frames=clip.n_frames, frames_as=kind) as add:
            add(clip)
        files += sorted((folder / kind).glob(f"*_[0-9]*.{kind}"))
    run_blender(Path(__file__).with_name("read_exports.py"), folder, *files)
    found = {}
    for file in files:
        with np.load(folder / f"{file.name}.npz") as arrays:
            found[file.suffix if file.stem == "walk" else file.name] = dict(arrays)
    return found


def names(ending: str) -> dict[str, str]:
    """What Blender calls garment and body: a cache moves the object of the OBJ beside it."""
    return (
        dict(garment="walk", body="walk_body")
        if ending in (".pc2", ".mdd")
        else dict(garment="garment", body="body")
    )


def in_parts(surface: Surface) -> np.ndarray:
    """The faces in the order of a GLB, which has those of one material together."""
    assert surface.face_materials is not None
    return np.argsort(surface.face_materials, kind="stable")


@pytest.mark.parametrize("ending", ENDINGS)
def test_vertices_are_where_they_were(
    ending: str, clip: Clip, opened: dict[str, dict[str, np.ndarray]]
) -> None:
    found, surface = opened[ending], clip.template.surface
    assert surface is not None
    assert clip.garment is not None
    wanted = {"garment": surface.of_file(clip.garment.vertices), "body": clip.body.vertices}
    assert found["objects"].tolist() == sorted(names(ending).values())
    for thing, name in names(ending).items():
        for frame in FRAMES:
            x, y, z = wanted[thing][frame].T
            placed = found[f"{name}_{frame}"]
            if (
                ending == ".glb" and thing == "garment"
            ):  # Blender numbers the vertices of each material's part anew
                x, y, z = wanted[thing][frame][surface.faces[in_parts(surface)]].reshape(-1, 3).T
                placed = placed[found[f"{name}_faces"]].reshape(-1, 3)
            np.testing.assert_allclose(
                placed, np.stack([x, -z, y], axis=1), atol=1e-5, err_msg=f"{name} {frame}"
            )


@pytest.mark.parametrize("ending", [".usd", ".usda", ".usdz", ".abc"])
def test_the_scene_has_the_clip_s_frames_and_rate(
    ending: str, clip: Clip, opened: dict[str, dict[str, np.ndarray]]
) -> None:
    assert opened[ending]["range"].tolist() == [0, clip.n_frames - 1]
    assert opened[ending]["fps"] == pytest.approx(clip.fps)


@pytest.mark.parametrize("ending", [ending for ending in ENDINGS if ending != ".abc"])  # which has no images
def test_the_texture_is_there(ending: str, opened: dict[str, dict[str, np.ndarray]]) -> None:
    assert [3, 2] in opened[ending]["images"].tolist()


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_files_of_a_folder_are_single_frames(
    kind: str, clip: Clip, folder: Path, opened: dict[str, dict[str, np.ndarray]]
) -> None:
    surface = clip.template.surface
    assert surface is not None
    assert clip.garment is not None
    wanted = {"garment": surface.of_file(clip.garment.vertices), "body": clip.body.vertices}
    for thing, frame in product(wanted, FRAMES):
        name = f"{thing}_{frame:04d}"
        found = opened[f"{name}.{kind}"]
        x, y, z = wanted[thing][frame].T
        placed = (
            np.stack([x, -z, y], axis=1) if kind == "obj" else wanted[thing][frame]
        )  # PLY is taken as it is
        assert found["objects"].tolist() == [name]
        if kind == "ply" and thing == "garment":  # Blender may cut at seams
            placed, seen = placed[surface.faces], found[f"{name}_0"][found[f"{name}_faces"]]
        else:
            seen = found[f"{name}_0"]
        np.testing.assert_allclose(seen, placed, atol=1e-5)


@pytest.mark.parametrize("ending", ENDINGS)
def test_corners_keep_their_coordinates_and_materials(
    ending: str, clip: Clip, opened: dict[str, dict[str, np.ndarray]]
) -> None:
    found, surface, name = opened[ending], clip.template.surface, names(ending)["garment"]
    assert surface is not None
    assert surface.face_materials is not None
    faces, uvs = found[f"{name}_faces"], found[f"{name}_uvs"]
    order = np.arange(len(faces))
    if ending == ".glb":  # one primitive a material, and copies at seams
        order = in_parts(surface)
    else:
        first = np.argmax(faces == surface.faces[:, :1], axis=1)  # Blender may begin at another corner
        turn = (first[:, None] + np.arange(3)) % 3
        faces, uvs = np.take_along_axis(faces, turn, 1), np.take_along_axis(uvs, turn[..., None], 1)
        np.testing.assert_array_equal(faces, surface.faces)
    np.testing.assert_allclose(uvs, surface.uvs[surface.uv_faces[order]], atol=1e-6)
    wanted = [surface.materials[number] for number in surface.face_materials[order]]
    assert found[f"{name}_materials"].tolist() == wanted
