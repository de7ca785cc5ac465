"""Every form of an animation, read again by the project's own readers; by hand where it has none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from imgtransfer.data.clip import Clip, load_clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.exports import ENDINGS, check_target, written_animation
from imgtransfer.exports.objects import COLOURS
from render import InputError, Option
from render.files.mesh_files import load_mesh
from render.files.point_caches import open_cache
from render.files.sequence import open_sequence
from render.mesh.surface import Surface
from tests.helpers.full_disk import full_disk
from tests.helpers.scenes import Usd, UsdGeom

SCENES = (".usd", ".usda", ".usdz", ".abc")
STEPS = 6  # frames of `tube_clip`


def write(path: Path, clip: Clip, *, together: int = 4, **arguments: object) -> Path:
    """Write a clip, some frames at a time, as a command does."""
    with written_animation(path, n_frames=clip.n_frames, **arguments) as add:
        for start in range(0, clip.n_frames, together):
            add(clip.slice(slice(start, start + together)))
    return path


@pytest.fixture
def dressed(tube_clip: Clip, tmp_path: Path) -> Clip:
    """The clip with a template that had seams: its first vertex twice in its file, two materials, one with an image."""
    cv2.imwrite(f"{tmp_path}/cloth.png", np.full((2, 3, 3), 200, np.uint8))
    count, faces = len(tube_clip.template.vertices), tube_clip.template.faces.copy()
    faces[0][faces[0] == faces[0, 0]] = count  # one corner is at a copy of its vertex
    random = np.random.default_rng(0)
    surface = Surface(
        faces=faces,
        vertices=np.append(np.arange(count), tube_clip.template.faces[0, 0]),
        uvs=random.random((7, 2)).astype(np.float32),
        uv_faces=random.integers(0, 7, faces.shape),
        face_materials=(np.arange(len(faces)) % 2).astype(np.int64),
        materials=("wool", "silk 2"),
        mtl=f"newmtl wool\nKd 0.5 0.25 0\nnewmtl silk 2\nmap_Kd {tmp_path}/cloth.png\n",
    )
    return tube_clip.with_surface(surface)


def meshes(path: Path) -> dict[str, object]:
    return {name: open_sequence(path, which=Option("mesh", name)) for name in ("garment", "body")}


@pytest.mark.parametrize("ending", SCENES)
def test_scenes_come_back_as_they_were(ending: str, dressed: Clip, tmp_path: Path) -> None:
    path = write(tmp_path / f"out/walk{ending}", dressed)
    surface = dressed.template.surface
    wanted = {"garment": surface.of_file(dressed.garment.vertices), "body": dressed.body.vertices}
    for name, sequence in meshes(path).items():
        np.testing.assert_allclose(sequence.vertices(), wanted[name], atol=1e-6)
        assert sequence.fps == pytest.approx(dressed.fps)


@pytest.mark.parametrize("ending", [".usd", ".abc"])
def test_corners_keep_coordinates_and_materials(ending: str, dressed: Clip, tmp_path: Path) -> None:
    found = open_sequence(write(tmp_path / f"walk{ending}", dressed), which=Option("mesh", "garment")).mesh
    surface, seen = dressed.template.surface, found.surface
    assert seen is not None
    assert seen.faces.tolist() == surface.faces.tolist()
    np.testing.assert_allclose(seen.uvs[seen.uv_faces], surface.uvs[surface.uv_faces])
    named = [seen.materials[number] for number in seen.face_materials]
    wanted = [surface.materials[number] for number in surface.face_materials]
    assert [name.replace("_", " ") for name in named] == wanted  # USD's names have no spaces


@pytest.mark.parametrize("ending", [".usd", ".abc"])
def test_names_that_a_form_does_not_take_are_changed(ending: str, dressed: Clip, tmp_path: Path) -> None:
    surface = replace(dressed.template.surface, materials=("a/b", "a_b"), mtl="")
    found = open_sequence(
        write(tmp_path / f"walk{ending}", dressed.with_surface(surface)), which=Option("mesh", "garment")
    ).mesh
    assert sorted(found.surface.materials) == ["a_b", "a_b_2"]
    wanted = [number == surface.face_materials[0] for number in surface.face_materials]
    seen = found.surface.face_materials
    assert [number == seen[0] for number in seen] == wanted


def test_an_object_without_materials_has_its_own_colour(tube_clip: Clip, tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(write(tmp_path / "walk.usda", tube_clip)))
    for name, colour in COLOURS.items():
        shader = stage.GetPrimAtPath(f"/clip/materials/{name}/surface")
        assert tuple(shader.GetAttribute("inputs:diffuseColor").Get()) == pytest.approx(colour[:3])


def test_a_stage_says_what_it_is(dressed: Clip, tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(write(tmp_path / "walk.usd", dressed, step=2)))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, 4)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == dressed.fps
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/clip/garment"))
    assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert mesh.GetPointsAttr().GetTimeSamples() == [0, 2, 4]
    np.testing.assert_allclose(mesh.GetExtentAttr().Get(2)[0], dressed.garment.vertices[2].min(0), atol=1e-6)
    texture = stage.GetPrimAtPath("/clip/materials/silk_2/texture").GetAttribute("inputs:file").Get()
    assert Path(texture.resolvedPath).read_bytes() == (tmp_path / "cloth.png").read_bytes()
    wool = stage.GetPrimAtPath("/clip/materials/wool/surface").GetAttribute("inputs:diffuseColor").Get()
    assert tuple(wool) == (0.5, 0.25, 0)
    assert stage.GetPrimAtPath("/clip/materials/silk_2").GetDisplayName() == "silk 2"


@pytest.mark.parametrize("ending", [".pc2", ".mdd"])
def test_a_cache_moves_the_mesh_beside_it(ending: str, dressed: Clip, tmp_path: Path) -> None:
    path = write(tmp_path / f"walk{ending}", dressed)
    surface = dressed.template.surface
    wanted = {"walk": surface.of_file(dressed.garment.vertices), "walk_body": dressed.body.vertices}
    for name, vertices in wanted.items():
        cache, mesh = open_cache(path.with_name(name + ending)), load_mesh(tmp_path / f"{name}.obj")
        np.testing.assert_array_equal(cache.vertices(), vertices)
        shown = mesh.vertices if mesh.surface is None else mesh.surface.of_file(mesh.vertices)
        assert len(shown) == cache.n_points
        assert cache.fps == (pytest.approx(dressed.fps, abs=1e-2) if ending == ".mdd" else None)
    assert load_mesh(tmp_path / "walk.obj").surface.materials == surface.materials


def test_the_header_of_a_cache_is_the_formats(tube_clip: Clip, tmp_path: Path) -> None:
    path = write(tmp_path / "a.pc2", tube_clip, step=4)
    wanted = b"POINTCACHE2\0" + np.array([1, 192], "<i4").tobytes()
    wanted += np.array([0, 4], "<f4").tobytes() + np.array([2], "<i4").tobytes()
    assert path.read_bytes()[:32] == wanted
    path = write(tmp_path / "b.mdd", tube_clip, step=4)
    head = np.array([2, 192], ">i4").tobytes() + np.array([0, 4 / 30], ">f4").tobytes()
    assert path.read_bytes()[:16] == head


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_a_folder_has_numbered_files_of_both(kind: str, tube_clip: Clip, tmp_path: Path) -> None:
    folder = write(tmp_path / "walk", tube_clip, step=4, frames_as=kind)
    names = [f"{name}_{frame:04d}" for name in ("body", "garment") for frame in (0, 4)]
    assert sorted(file.stem for file in folder.glob(f"*.{kind}")) == sorted([*names, "body_rest", "template"])
    np.testing.assert_allclose(
        load_mesh(folder / f"garment_0004.{kind}").vertices, tube_clip.garment.vertices[4], atol=1e-6
    )


@pytest.mark.parametrize("together", [1, 2, 5, 6])
@pytest.mark.parametrize("step", [1, 2, 5, 9])
def test_parts_and_steps_fit_whatever_their_numbers(
    together: int, step: int, tube_clip: Clip, tmp_path: Path
) -> None:
    cache = open_cache(write(tmp_path / "a.pc2", tube_clip, together=together, step=step))
    np.testing.assert_array_equal(cache.vertices(), tube_clip.garment.vertices[::step])


@pytest.mark.parametrize("ending", [".usd", ".abc", ".pc2", ".npz"])
def test_a_clip_of_a_body_alone(ending: str, tube_clip: Clip, tmp_path: Path) -> None:
    path = write(tmp_path / f"a{ending}", replace(tube_clip, garment=None))
    if ending == ".npz":
        assert load_clip(path).garment is None
    elif ending == ".pc2":
        np.testing.assert_array_equal(open_cache(path).vertices(), tube_clip.body.vertices)
    else:
        (moved,) = open_sequence(path).parts(99)
        np.testing.assert_allclose(moved, tube_clip.body.vertices, atol=1e-6)


@pytest.mark.parametrize("ending", [*ENDINGS, ""])
def test_nothing_is_left_of_what_failed(ending: str, tube_clip: Clip, tmp_path: Path) -> None:
    target = tmp_path / f"out/walk{ending}"

    def fail() -> None:
        with written_animation(target, n_frames=STEPS) as add:
            add(tube_clip.slice(slice(0, 2)))
            raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        fail()
    assert not target.exists()
    assert not list(target.parent.iterdir())


@pytest.mark.parametrize("ending", [*ENDINGS, ""])
def test_a_full_disk_is_an_error_that_names_the_file(ending: str, tube_clip: Clip, tmp_path: Path) -> None:
    target = tmp_path / f"out/walk{ending}"
    with full_disk(4096), pytest.raises((OSError, InputError), match="walk"):
        write(target, tube_clip)
    assert not target.exists()
    assert not list(target.parent.iterdir())


@pytest.mark.parametrize("ending", [".usd", ".abc"])
def test_a_disk_that_fills_up_while_frames_come_is_an_error_of_one_line(
    ending: str, tube_clip: Clip, tmp_path: Path
) -> None:
    target = tmp_path / f"walk{ending}"
    moving = tube_clip.garment.vertices + np.random.default_rng(0).random((6, 192, 3)).astype(np.float32)
    long = replace(tube_clip, garment=Garment(moving))

    def fill() -> None:
        with written_animation(target, n_frames=600) as add:
            for _ in range(100):
                add(long)

    with full_disk(200_000), pytest.raises((OSError, InputError), match="walk") as caught:
        fill()
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "message"), [
    ("a.fbx", r"a.fbx: no '.fbx' is written; wanted is a name that ends in .npz, .glb, .usd"),
    ("a.obj", r"or a folder \(a name without a dot\) for one OBJ or PLY file a frame"),
    ("there", "there: exists already; give the name of a new folder"),
    ("there.glb", "there.glb: is a folder; wanted is the name of a .glb file"),
])  # fmt: skip
def test_targets_that_cannot_be_written(name: str, message: str, tmp_path: Path) -> None:
    for there in ("there", "there.glb"):
        (tmp_path / there).mkdir()
    with pytest.raises(InputError, match=message):
        check_target(tmp_path / name)


def test_the_mesh_beside_a_cache_replaces_no_other(tube_clip: Clip, tmp_path: Path) -> None:
    write(tmp_path / "walk.mdd", tube_clip)
    write(tmp_path / "walk.mdd", tube_clip)  # its own
    (tmp_path / "shirt_body.obj").touch()
    with pytest.raises(InputError, match=r"shirt_body\.obj: exists already and would be replaced"):
        check_target(tmp_path / "shirt.pc2")


def test_options_of_other_forms_are_refused(tube_clip: Clip, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a \.npz holds every frame"):
        write(tmp_path / "a.npz", tube_clip, step=2)
    with pytest.raises(InputError, match=r"goes with a folder, but .*a.glb is a .glb"):
        write(tmp_path / "a.glb", tube_clip, frames_as="ply")
    assert not list(tmp_path.iterdir())


def test_npz_has_all_arrays(tube_clip: Clip, tmp_path: Path) -> None:
    found = load_clip(write(tmp_path / "a.npz", tube_clip))
    for key, values in tube_clip.arrays().items():
        np.testing.assert_array_equal(found.arrays()[key], values)


def test_moved_vertices_of_a_prediction_take_the_place(tube_clip: Clip, tmp_path: Path) -> None:
    moved = tube_clip.garment.vertices + 1
    path = write(tmp_path / "a.pc2", replace(tube_clip, garment=Garment(moved)))
    np.testing.assert_array_equal(open_cache(path).vertices(), moved)
