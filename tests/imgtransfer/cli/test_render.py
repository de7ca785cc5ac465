"""`imgtransfer render` on clips and on plain meshes: maps, sheets and what is refused."""

from __future__ import annotations

import shutil
from dataclasses import fields, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.clip_parts import Skeleton
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.pipeline import scene as scene_module
from imgtransfer.pipeline.scene import Scene, mesh_scene
from render import MapFile, load_maps

SMALL = ("--size", "32")


@pytest.fixture
def clips(tmp_path: Path, tube_clip: Clip) -> Path:
    """Two clips: bend and short, six and four frames."""
    save_clip(tmp_path / "clips/bend.npz", tube_clip)
    save_clip(tmp_path / "clips/short.npz", tube_clip.slice(slice(0, 4)))
    return tmp_path / "clips"


@pytest.fixture
def meshes(tmp_path: Path, tube_clip: Clip) -> Path:
    """Garment and body of the clip at rest, and in motion in folders of their own, frame by frame."""
    assert tube_clip.garment is not None
    for name, rest, frames, faces in (
        ("shirt", tube_clip.template.vertices, tube_clip.garment.vertices, tube_clip.template.faces),
        ("body", tube_clip.body.rest, tube_clip.body.vertices, tube_clip.body.faces),
    ):
        (tmp_path / "meshes" / name).mkdir(parents=True)
        for place, vertices in (
            (f"{name}.obj", rest),
            *((f"{name}/f_{k:02d}.ply", v) for k, v in enumerate(frames)),
        ):
            trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "meshes" / place)
    return tmp_path / "meshes"


def render(*argv: object) -> int:
    return main(["render", *(str(arg) for arg in (*argv, *SMALL))])


def refused(capsys: pytest.CaptureFixture[str], out: Path, *argv: object) -> str:
    """The one line on stderr of a command that must fail and leave nothing."""
    capsys.readouterr()
    assert render(*argv, "--out", out) == 2
    printed, error = capsys.readouterr()
    assert printed == ""
    assert error.count("\n") == 1
    assert not out.exists() or list(out.iterdir()) == []
    return error


def test_a_clip_becomes_maps_and_sheets(clips: Path, tmp_path: Path, tube_clip: Clip) -> None:
    argv = ["render", str(clips), "--clip", "short", "--out", f"{tmp_path}/maps", "--size", "48x32"]
    assert main([*argv, "--frames", "1:4:2", "--backend", "numpy", "--root", "root"]) == 0
    folder = tmp_path / "maps/short"
    ends = (".npz", "_maps.png", "_template.png")
    names = [f"{mesh}{end}" for mesh in ("body", "garment") for end in ends]
    assert sorted(file.name for file in folder.iterdir()) == sorted([*names, "frames.png"])
    maps, body = load_maps(folder / "garment.npz"), load_maps(folder / "body.npz")
    assert maps.position is not None
    assert maps.position.shape == (2, 2, 48, 32, 3)
    np.testing.assert_array_equal(maps.box_lo, body.box_lo)
    np.testing.assert_array_equal(maps.view_matrices, body.view_matrices)
    seen = maps.box.decode(maps.position[0][maps.mask]) @ maps.rotation[0].T + maps.translation[0]
    assert tube_clip.garment is not None
    truth = tube_clip.garment.vertices[1]
    assert ((seen >= truth.min(0) - 1e-4) & (seen <= truth.max(0) + 1e-4)).all()
    for sheet in folder.glob("*.png"):
        assert cv2.imread(str(sheet)).std() > 10


def test_exr_holds_what_the_npz_holds(clips: Path, tmp_path: Path) -> None:
    for kind in ("npz", "exr"):
        argv = (clips / "short.npz", "--frames", "::3", "--layers", "2", "--format", kind)
        assert render(*argv, "--out", tmp_path / kind) == 0
    exr, npz = load_maps(tmp_path / "exr/short/garment"), load_maps(tmp_path / "npz/short/garment.npz")
    for field in fields(MapFile):
        np.testing.assert_array_equal(getattr(exr, field.name), getattr(npz, field.name))
    assert exr.views == ("front", "front/1", "back", "back/1")
    assert exr.layers is not None
    assert exr.layers.tolist() == [0, 1, 0, 1]


def test_plain_meshes_with_a_body_give_the_clip_s_maps(meshes: Path, tmp_path: Path, tube_clip: Clip) -> None:
    body = ("--body", meshes / "body", "--body-template", meshes / "body.obj", "--root", "root")
    out = ("--fps", "30", "--out", tmp_path / "a")
    assert render(meshes / "shirt", "--template", meshes / "shirt.obj", *body, *out) == 0
    bare = replace(tube_clip, skeleton=Skeleton(), info={})
    save_clip(tmp_path / "shirt.npz", bare)  # meshes know no poses
    assert render(tmp_path / "shirt.npz", "--root", "root", "--out", tmp_path / "b") == 0
    for name in ("garment", "body"):
        one, other = (load_maps(tmp_path / place / "shirt" / f"{name}.npz") for place in "ab")
        for field in ("position", "normal", "mask", "box_lo", "rotation", "translation", "fps"):
            np.testing.assert_allclose(getattr(one, field), getattr(other, field), atol=1e-5)


@pytest.mark.parametrize("kind", ["one file", "pattern", "folder of GLB"])
def test_meshes_alone_stay_where_they_are(meshes: Path, tmp_path: Path, kind: str, tube_clip: Clip) -> None:
    assert tube_clip.garment is not None
    source = {"one file": meshes / "shirt/f_02.ply", "pattern": f"{meshes}/shirt/f_0[2-4].ply"}.get(kind)
    if source is None:
        source = meshes / "glb"
        source.mkdir()
        for k in (2, 3, 4):
            mesh = trimesh.Trimesh(tube_clip.garment.vertices[k], tube_clip.template.faces, process=False)
            mesh.export(source / f"{k}.glb")
    assert render(source, "--template", meshes / "shirt.obj", "--out", tmp_path / "out") == 0
    (folder,) = (tmp_path / "out").iterdir()
    maps = load_maps(folder / "garment.npz")
    assert len(maps.rotation) == (1 if kind == "one file" else 3)
    np.testing.assert_array_equal(maps.rotation[0], np.eye(3))
    assert maps.fps == 30
    assert maps.position is not None
    seen, truth = maps.box.decode(maps.position[0][maps.mask]), tube_clip.garment.vertices[2]
    assert ((seen >= truth.min(0) - 1e-4) & (seen <= truth.max(0) + 1e-4)).all()


def test_frames_too_many_for_memory_are_read_again_and_give_the_same_files(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    body = ("--body", meshes / "body", "--body-template", meshes / "body.obj")
    argv = (
        meshes / "shirt",
        "--template",
        meshes / "shirt.obj",
        *body,
        "--frames",
        "1:6:2",
        "--against",
        meshes / "shirt",
    )
    told = []
    for place, most in (("memory", scene_module._MOST_IN_MEMORY), ("files", 0)):
        monkeypatch.setattr(scene_module, "_MOST_IN_MEMORY", most)
        assert render(*argv, "--out", tmp_path / place) == 0
        told.append(capsys.readouterr().out.replace(place, ""))
    assert told[0] == told[1]
    names = sorted(file.name for file in (tmp_path / "memory/shirt").iterdir())
    assert len(names) == 9
    for name in names:
        one, other = (tmp_path / place / "shirt" / name for place in ("memory", "files"))
        if name.endswith(".png"):
            assert one.read_bytes() == other.read_bytes()
            continue
        for field in fields(MapFile):
            np.testing.assert_array_equal(*(getattr(load_maps(path), field.name) for path in (one, other)))


def test_the_difference_of_two_sources_is_drawn_and_told(
    clips: Path, tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    assert tube_clip.garment is not None
    moved = tube_clip.with_garment(tube_clip.garment.vertices + np.float32([0, 0.003, 0.004]))
    save_clip(tmp_path / "moved.npz", moved)
    argv = (clips / "bend.npz", "--against", tmp_path / "moved.npz", "--out", tmp_path / "out")
    assert render(*argv) == 0
    told = capsys.readouterr().out
    assert "garment: 5.000 mm apart on average, 5.000 mm at most" in told
    assert "body: 0.000 mm apart" in told
    sheet = cv2.imread(str(tmp_path / "out/bend/garment_difference.png"))
    assert sheet.shape[0] > 5 * 32 + 44  # five frames and the bar
    assert (tmp_path / "out/bend/body_difference.png").is_file()


def test_meshes_are_compared_too(meshes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    argv = (meshes / "shirt/f_01.ply", "--template", meshes / "shirt.obj", "--out", tmp_path / "out")
    assert render(*argv, "--against", meshes / "shirt/f_02.ply") == 0
    assert "garment: " in capsys.readouterr().out


def test_clips_that_cannot_be_compared(
    clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    error = refused(capsys, out, clips / "bend.npz", "--against", clips / "short.npz")
    assert "--against short: its body has 4 frames" in error
    assert "no clip bend" in refused(capsys, out, clips, "--against", clips / "short.npz")
    assert "no such file" in refused(capsys, out, clips, "--against", clips / "none.npz")


def unequal(folder: Path) -> None:
    trimesh.creation.box().export(folder / "shirt/f_03.ply")


def other_topology(folder: Path) -> None:
    mesh = trimesh.load(folder / "shirt/f_03.ply", process=False)
    trimesh.Trimesh(mesh.vertices, mesh.faces[::-1], process=False).export(folder / "shirt/f_03.ply")


def other_template(folder: Path) -> None:
    trimesh.creation.box().export(folder / "shirt.obj")


def emptied(folder: Path) -> None:
    for file in (folder / "shirt").iterdir():
        file.unlink()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (unequal, "8 vertices, but the first frame has 192"),
        (other_topology, "other triangles"),
        (other_template, "but the template"),
        (emptied, "no OBJ"),
        (lambda f: (f / "shirt/f_02.ply").write_bytes(b"no mesh"), "f_02.ply: cannot be read"),
        (lambda f: (f / "shirt/f_02.ply").unlink(), "frames are missing"),
        (lambda f: (f / "shirt.obj").unlink(), "shirt.obj: no such file"),
    ],
)
def test_meshes_that_do_not_belong_together(
    meshes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil, message: str
) -> None:
    spoil(meshes)
    error = refused(capsys, tmp_path / "out", meshes / "shirt", "--template", meshes / "shirt.obj")
    assert message in error


def test_options_that_do_not_go_together(
    meshes: Path, clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rest = ("--template", meshes / "shirt.obj")
    for argv, message in (
        ((meshes / "shirt",), "with --template FILE"),
        ((meshes / "shirt/f_01.ply",), "with --template FILE"),
        ((meshes / "none", *rest), "no such folder"),
        ((meshes / "shirt", *rest, "--body", meshes / "body"), "belong together"),
        ((meshes / "shirt", *rest, "--root", "root"), "there is no body"),
        ((meshes / "shirt", *rest, "--clip", "a"), "there are none"),
        ((meshes / "shirt", *rest, "--frames", "9:"), "none of these"),
        ((meshes / "shirt", *rest, "--fps", "0"), "fps"),
        ((clips / "bend.npz", "--fps", "30"), "--fps: only for plain meshes"),
        ((clips / "bend.npz", "--views", "ring:0"), "ring"),
    ):
        assert message in refused(capsys, tmp_path / "out", *argv)


def test_a_body_of_other_length_is_refused(
    meshes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = sorted((meshes / "body").iterdir())
    (tmp_path / "body").mkdir()
    for frame in frames[:-1]:
        shutil.copy(frame, tmp_path / "body")
    body = ("--body", tmp_path / "body", "--body-template", meshes / "body.obj")
    error = refused(capsys, tmp_path / "out", meshes / "shirt", "--template", meshes / "shirt.obj", *body)
    assert f"{tmp_path / 'body'} has {len(frames) - 1} frames" in error
    assert "both must have the same frames" in error


# how the files' coordinates lie


def foreign(points: np.ndarray) -> np.ndarray:
    """Metres, y up, facing +z -> centimetres, z up, facing -y, as from Blender."""
    x, y, z = np.moveaxis(100 * points, -1, 0)
    return np.stack([x, -z, y], axis=-1)


def turned(source: Path, folder: Path) -> Path:
    """A copy of mesh files in `foreign` coordinates."""
    for file in source.rglob("*.*"):
        target = folder / file.relative_to(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        mesh = trimesh.load(file, process=False)
        trimesh.Trimesh(foreign(mesh.vertices), mesh.faces, process=False).export(target)
    return folder


def scene(shirt: Path, body: Path, **axes: Axes) -> Scene:
    worn = {"body_template": body / "body.obj", "body": body / "body"}
    return mesh_scene(shirt / "shirt.obj", shirt / "shirt", **worn, root="root", **axes)


def test_other_axes_and_units_give_the_same_scene(meshes: Path, tmp_path: Path) -> None:
    other, blender = turned(meshes, tmp_path / "other"), Axes("z", "-y", 0.01)
    wanted = scene(meshes, meshes)
    for found in (scene(other, other, axes=blender), scene(other, meshes, garment_axes=blender)):
        np.testing.assert_allclose(found.framed.vertices, wanted.framed.vertices, atol=1e-6)
        np.testing.assert_allclose(found.frames.rotation, wanted.frames.rotation, atol=1e-5)
        for name, mesh in wanted.meshes.items():
            np.testing.assert_allclose(found.meshes[name].vertices(), mesh.vertices(), atol=1e-6)


def test_welded_seams_have_smooth_normals(tmp_path: Path) -> None:
    """A roof of two squares whose ridge is split: welded, one normal for both, of three triangles."""
    roof = np.array(
        [[-1, 0, 0], [-1, 0, 1], [0, 1, 0], [0, 1, 1], [0, 1, 0], [0, 1, 1], [1, 0, 0], [1, 0, 1.0]]
    )
    faces = [[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6]]
    trimesh.Trimesh(foreign(roof), faces, process=False).export(tmp_path / "roof.obj")
    found = []
    for out, options in (("split", ()), ("welded", ("--weld",))):
        argv = ("--template", tmp_path / "roof.obj", "--views", "0/80", "--up=z", "--unit=cm", *options)
        assert render(tmp_path / "roof.obj", *argv, "--out", tmp_path / out) == 0
        maps = load_maps(tmp_path / out / "roof/garment.npz")
        assert maps.normal is not None
        found.append((len(maps.template_vertices), maps.normal[0][maps.mask][:, 1].max()))
    (before, flat), (after, up) = found
    assert (before, after) == (8, 6)
    assert flat == pytest.approx((0.5**0.5 + 1) / 2, abs=1e-3)  # encoded: 1 is straight up
    assert up == pytest.approx(
        (3 / 10**0.5 + 1) / 2, abs=0.01
    )  # of one triangle on one side, two on the other


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--unit=cm"], "--unit: only for plain meshes, together with --template"),
        (["--weld"], "--weld: only for plain meshes, together with --template"),
        (["--template", "shirt.obj", "--unit=cm", "--garment-unit=mm"], "--unit does nothing here"),
        (["--template", "shirt.obj", "--unit=parsec"], "--unit parsec: one of m, cm, mm"),
        (["--template", "shirt.obj", "--up=z", "--facing=z"], "the two must be different axes"),
    ],
)
def test_axes_that_make_no_sense(  # noqa: PLR0917
    meshes: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(meshes)
    assert message in refused(capsys, tmp_path / "out", "shirt", *options)
