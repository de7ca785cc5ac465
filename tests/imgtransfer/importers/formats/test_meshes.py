"""Own garments and bodies: from files in many forms to a clip and back, with UVs, materials and vertex order."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.clip_parts import Body, Garment, Template
from imgtransfer.data.mesh_output import save_mesh_frames
from imgtransfer.data.store import DataSet
from imgtransfer.importers.checks.axes import Axes
from render import InputError, Mesh, load_mesh
from render.mesh.surface import Surface
from tests.helpers.import_examples import split, standing_body, vest, write_mdd, write_obj, write_pc2

FRAMES = 4
BODY = standing_body()
VEST = vest(BODY)


def moving(vertices: np.ndarray) -> np.ndarray:
    """(T, N, 3): a walk ahead with a slow turn."""
    angle = 0.1 * np.arange(FRAMES)
    turned = np.stack([np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)], -1).reshape(-1, 2, 2)
    moved = np.repeat(vertices[None], FRAMES, axis=0)
    moved[..., [0, 2]] = np.einsum("tab,nb->tna", turned, vertices[:, [0, 2]])
    moved[..., 2] += 0.1 * np.arange(FRAMES)[:, None]
    return moved


SPLIT = split(VEST)


def write_clip(
    folder: Path, garment: Mesh = VEST, axes: Axes | None = None, *, kind: str = "folders"
) -> Path:
    """A clip's folder, in the axes and units of `axes`."""
    axes = axes or Axes()

    def theirs(vertices: np.ndarray) -> np.ndarray:
        return vertices @ axes.rotation / axes.scale

    for what, mesh in (("garment", garment), ("body", BODY)):
        motion, rest = (
            theirs(moving(mesh.vertices)),
            Mesh(theirs(mesh.vertices), mesh.faces, surface=mesh.surface),
        )
        name = {"garment": "template", "body": "body_rest"}[what]
        save_mesh_frames(folder.parent / f".{name}", rest.vertices[None], rest, "obj", name=name)
        folder.mkdir(parents=True, exist_ok=True)
        for file in (folder.parent / f".{name}").iterdir():
            file.rename(folder / (f"{name}.obj" if file.suffix == ".obj" else file.name))
        if kind == "folders":
            save_mesh_frames(folder / what, motion, rest, "obj")
        elif kind == "prefixes":
            save_mesh_frames(folder / ".frames", motion, rest, "ply", name=what)
            for file in (folder / ".frames").iterdir():
                file.rename(folder / file.name)
            (folder / ".frames").rmdir()
        elif kind == "pc2":
            write_pc2(folder / f"{what}.pc2", motion)
        else:
            write_mdd(folder / f"{what}.mdd", motion, 24.0)
    return folder


def imported(tmp_path: Path, folder: Path, *options: object) -> Clip:
    """The clip after `imgtransfer import meshes`."""
    argv = ["import", "meshes", folder, "--to", tmp_path / "set", "--split", "train", *options]
    assert main([str(arg) for arg in argv]) == 0
    data = DataSet.open(tmp_path / "set")
    return data.read(data.names()[-1])


def error(capsys: pytest.CaptureFixture[str], folder: Path, *options: object) -> str:
    """The one line of an import that must fail."""
    capsys.readouterr()
    argv = ["import", "meshes", folder, "--to", folder.parent / "set", "--split", "train", *options]
    assert main([str(arg) for arg in argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize("kind", ["folders", "prefixes", "pc2", "mdd"])
def test_every_form_gives_the_same_clip(tmp_path: Path, kind: str) -> None:
    clip = imported(tmp_path, write_clip(tmp_path / "in/walk", kind=kind))
    assert clip.name == "garment/walk"
    np.testing.assert_allclose(clip.garment.vertices, moving(VEST.vertices), atol=2e-6)
    np.testing.assert_allclose(clip.body.vertices, moving(BODY.vertices), atol=2e-6)
    np.testing.assert_allclose(clip.template.vertices, VEST.vertices, atol=2e-6)
    np.testing.assert_allclose(clip.body.rest, BODY.vertices, atol=2e-6)
    np.testing.assert_array_equal(clip.template.faces, VEST.faces)
    assert clip.fps == pytest.approx(24 if kind == "mdd" else 30, abs=0.01)


def test_other_axes_and_units_are_turned_into_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_clip(tmp_path / "in/walk", axes=Axes("z", "-y", 0.01))
    message = error(capsys, folder)
    assert "its file seems to be in cm: add --unit=cm" in message
    assert "stands along z and faces -y, not y and z; add --up=z --facing=-y" in message
    clip = imported(tmp_path, folder, "--unit=cm", "--up=z", "--facing=-y", "--garment", "vest")
    assert clip.name == "vest/walk"
    np.testing.assert_allclose(clip.garment.vertices, moving(VEST.vertices), atol=1e-5)
    np.testing.assert_allclose(clip.body.rest, BODY.vertices, atol=1e-5)


def test_a_garment_in_millimetres_on_a_body_in_metres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write_clip(tmp_path / "in/walk")
    big = Mesh(VEST.vertices * 1000, VEST.faces)
    save_mesh_frames(folder / "garment", moving(VEST.vertices) * 1000, big, "obj")
    write_obj(folder / "template.obj", big.vertices, big.faces)
    assert "add --garment-unit=mm" in error(capsys, folder)
    clip = imported(tmp_path, folder, "--garment-unit", "mm")
    np.testing.assert_allclose(clip.garment.vertices, moving(VEST.vertices), atol=1e-5)


def test_without_a_rest_pose_the_first_frame_is_taken(tmp_path: Path) -> None:
    folder = write_clip(tmp_path / "in/walk")
    for name in ("template.obj", "body_rest.obj"):
        (folder / name).unlink()
    clip = imported(tmp_path, folder)
    assert clip.garment is not None
    np.testing.assert_array_equal(clip.template.vertices, clip.garment.vertices[0])


def test_one_clip_by_its_paths(tmp_path: Path) -> None:
    folder = write_clip(tmp_path / "in/walk", kind="prefixes")
    argv = [
        "import",
        "meshes",
        "--garment-frames",
        folder / "garment_*.ply",
        "--body-frames",
        folder / "body_*.ply",
    ]
    argv += ["--template", folder / "template.obj", "--body-rest", folder / "body_rest.obj"]
    argv += ["--to", tmp_path / "set", "--split", "test", "--fps", 60]
    assert main([str(arg) for arg in argv]) == 0
    clip = DataSet.open(tmp_path / "set").read("garment/walk")
    assert clip.fps == 60
    np.testing.assert_allclose(clip.garment.vertices, moving(VEST.vertices), atol=2e-6)


def test_several_folders_and_a_second_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("walk_2", "walk_10"):
        write_clip(tmp_path / "in" / name)
    imported(tmp_path, tmp_path / "in")
    assert DataSet.open(tmp_path / "set").names() == ["garment/walk_10", "garment/walk_2"]
    capsys.readouterr()
    imported(tmp_path, tmp_path / "in")
    out = capsys.readouterr().out
    assert "done     2 clips (2 there already)" in out
    assert out.splitlines()[-1] == f"next     imgtransfer inspect {tmp_path / 'set'}"


# what is wrong is said before any work


def test_seams_ask_for_weld(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = error(capsys, write_clip(tmp_path / "in/walk", SPLIT))
    assert "lie on others, where seams were split" in message
    assert "add --weld" in message
    assert not (tmp_path / "in/set").exists()


def test_missing_parts_of_a_clip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_clip(tmp_path / "in/walk", kind="pc2")
    (folder / "template.obj").unlink()
    assert "a point cache has no triangles; put the mesh that it moves beside it as template.obj" in error(
        capsys, folder
    )
    (folder / "garment.pc2").unlink()
    assert "no garment in it; wanted is a folder garment/ of OBJ or PLY frames" in error(capsys, folder)
    assert "no such file or folder" in error(capsys, tmp_path / "in/none")


def test_clips_that_do_not_fit_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_clip(tmp_path / "in/walk", kind="pc2")
    write_pc2(folder / "garment.pc2", moving(VEST.vertices)[:3])
    assert "3 frames, but" in error(capsys, folder)
    write_pc2(folder / "garment.pc2", moving(VEST.vertices)[:, 1:])
    assert "points a frame, but" in error(capsys, folder)
    frames = write_clip(tmp_path / "in/run")
    (frames / "body/frame_0003.obj").unlink()
    assert "4 frames (frame_0000.obj to frame_0003.obj), but" in error(capsys, frames)
    away = moving(VEST.vertices)
    away[2:] += 3
    write_pc2(folder / "garment.pc2", away)
    assert "not on the body in frame 2" in error(capsys, folder)
    assert imported(tmp_path, folder, "--anyway").n_frames == FRAMES
    other = vest(BODY, gap=0.02)
    write_obj(folder / "template.obj", other.vertices, other.faces[::-1])
    save_mesh_frames(folder / "garment", moving(VEST.vertices), VEST, "obj")
    assert "the rest pose must be the garment's own mesh" in error(capsys, folder)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--unit", "parsec"], "--unit parsec: one of m, cm"),
        (["--unit", "cm", "--scale", "0.01"], "say the same"),
        (["--scale", "0"], "positive number of metres"),
        (["--up", "q"], "--up=q: one of x, y, z"),
        (["--fps", "0"], "positive number of frames"),
        (["--smpl", "x"], "--smpl goes with vto"),
        (["--template", "none.obj"], "none.obj: no such file"),
        (["--garment-frames", "x"], "go together, with meshes and without PATH"),
        (["--clip", "other*"], "no clip matches (names other*); there are garment/walk"),
    ],
)
def test_options_without_sense(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert message in error(capsys, write_clip(tmp_path / "in/walk"), *options)


def test_formats_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for argv, message in (
        (["import", "meshes", "--to", tmp_path / "o"], "import meshes: what to import?"),
        (["import", "--to", tmp_path / "o"], "import clips: what to import?"),
        (["import", "vto", tmp_path / "none", "--to", tmp_path / "o"], "no such file or folder"),
        (["import", "clips", tmp_path, "--to", tmp_path / "o", "--weld"], "--weld goes with meshes"),
        (["import", "meshes", write_clip(tmp_path / "in/walk"), "--to", tmp_path / "o"], "add --split"),
    ):
        assert main([str(arg) for arg in argv]) == 2
        assert message in capsys.readouterr().err


# UVs, materials and vertex order in every output


@pytest.fixture
def welded(tmp_path: Path) -> Path:
    """A data set with the split garment, welded."""
    clip = imported(tmp_path, write_clip(tmp_path / "in/walk", SPLIT), "--weld")
    assert clip.template.vertices.shape == VEST.vertices.shape
    assert clip.template.surface.vertices is not None
    assert len(clip.template.surface.vertices) == len(SPLIT.vertices) > len(VEST.vertices)
    return tmp_path / "set"


def assert_same_look(found: Surface | None, wanted: Surface | None) -> None:
    assert found is not None
    assert wanted is not None
    assert found.uvs is not None
    assert found.uv_faces is not None
    assert wanted.uvs is not None
    np.testing.assert_allclose(found.uvs[found.uv_faces], wanted.uvs[wanted.uv_faces], atol=1e-6)
    np.testing.assert_array_equal(found.faces, wanted.faces)


def test_the_look_survives_import_npz_and_export(tmp_path: Path, welded: Path) -> None:
    assert main(["export", str(welded), "--out", f"{tmp_path}/clip.npz"]) == 0
    clip = load_clip(tmp_path / "clip.npz")
    assert_same_look(clip.template.surface, SPLIT.surface)
    assert clip.template.surface is not None
    assert clip.template.surface.materials == ("front", "side panel")
    np.testing.assert_array_equal(
        clip.slice(slice(0, 2)).template.surface.vertices, clip.template.surface.vertices
    )
    assert clip.garment is not None
    assert_same_look(clip.with_garment(clip.garment.vertices).template.surface, SPLIT.surface)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_exported_frames_are_the_files_own_mesh(tmp_path: Path, welded: Path, kind: str) -> None:
    assert main(["export", str(welded), "--out", f"{tmp_path}/frames", "--frames-as", kind]) == 0
    mesh = load_mesh(tmp_path / f"frames/garment_0003.{kind}")
    np.testing.assert_allclose(mesh.vertices, moving(SPLIT.vertices)[3], atol=2e-6)
    np.testing.assert_array_equal(mesh.faces, SPLIT.faces)
    assert_same_look(mesh.surface, SPLIT.surface)
    if kind == "obj":
        assert mesh.surface is not None
        assert mesh.surface.materials == ("front", "side panel")
        np.testing.assert_array_equal(mesh.surface.face_materials, SPLIT.surface.face_materials)  # type: ignore[union-attr]
        assert "Kd 0.1 0.1 0.8" in mesh.surface.mtl
    again = imported(tmp_path / "again", tmp_path / "frames", "--weld")  # what export wrote can be imported
    assert_same_look(again.template.surface, SPLIT.surface)


def test_fused_meshes_have_the_files_look(tmp_path: Path, welded: Path) -> None:
    """From the data set through maps and the fusion to mesh files: vertices, texture coordinates and materials."""
    (tmp_path / "fusion.yaml").write_text("edge_iterations: 2\nnormal_iterations: 2\n")
    maps = ["render", str(welded), "--size", "48", "--frames", "0:2", "--out", f"{tmp_path}/maps"]
    assert main(maps) == 0
    assert main(["export", str(welded), "--out", f"{tmp_path}/clip.npz"]) == 0
    save_clip(tmp_path / "clip.npz", load_clip(tmp_path / "clip.npz").slice(slice(0, 2)))
    (file,) = (tmp_path / "maps").rglob("garment.npz")
    argv = [
        "fuse",
        "--maps",
        file,
        "--body",
        tmp_path / "clip.npz",
        "--out",
        tmp_path / "out",
        "--meshes",
        "obj",
    ]
    assert main([str(arg) for arg in [*argv, "--config", tmp_path / "fusion.yaml"]]) == 0
    mesh = load_mesh(tmp_path / "out/meshes/frame_0001.obj")
    assert_same_look(mesh.surface, SPLIT.surface)
    assert np.linalg.norm(mesh.vertices - moving(SPLIT.vertices)[1], axis=-1).mean() < 0.01
    assert_same_look(load_clip(tmp_path / "out/fused.npz").template.surface, SPLIT.surface)


def test_clips_that_are_there_are_left(
    tmp_path: Path, welded: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(welded), "--out", f"{tmp_path}/shirt_walk.npz"]) == 0
    argv = ["import", f"{tmp_path}/shirt_walk.npz", "--to", f"{tmp_path}/other", "--split", "train"]
    for already in ("done     1 clips in", "done     1 clips (1 there already) in"):
        capsys.readouterr()
        assert main(argv) == 0
        assert already in capsys.readouterr().out
    assert main([*argv[:-1], "test"]) == 0  # in another split it is written again
    assert DataSet.open(tmp_path / "other").names("test") == ["shirt/walk"]


def test_a_data_set_is_imported_with_its_names_and_splits(tmp_path: Path, welded: Path) -> None:
    assert main(["import", str(welded), "--to", f"{tmp_path}/copy"]) == 0
    assert DataSet.open(tmp_path / "copy").names("train") == DataSet.open(welded).names()


def glb(path: Path) -> tuple[dict, bytes]:
    content = path.read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + length]), content[28 + length :]


def accessor(document: dict, binary: bytes, index: int) -> np.ndarray:
    entry = document["accessors"][index]
    view = document["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[entry["type"]]
    dtype = {5126: "<f4", 5125: "<u4"}[entry["componentType"]]
    return np.frombuffer(binary, dtype, entry["count"] * width, view["byteOffset"]).reshape(-1, width)


def test_the_animation_has_uvs_and_materials(tmp_path: Path, welded: Path) -> None:
    assert main(["export", str(welded), "--out", f"{tmp_path}/clip.glb"]) == 0
    document, binary = glb(tmp_path / "clip.glb")
    garment = next(mesh for mesh in document["meshes"] if mesh["name"] == "garment")
    looks = [document["materials"][primitive["material"]] for primitive in garment["primitives"]]
    assert [look["name"] for look in looks] == ["front", "side panel"]
    np.testing.assert_allclose(looks[1]["pbrMetallicRoughness"]["baseColorFactor"], [0.1, 0.1, 0.8, 0.5])
    assert looks[1]["alphaMode"] == "BLEND"
    first = garment["primitives"][0]["attributes"]
    faces = np.concatenate(
        [accessor(document, binary, p["indices"]).reshape(-1, 3) for p in garment["primitives"]]
    )
    places, uvs = (accessor(document, binary, first[key]) for key in ("POSITION", "TEXCOORD_0"))
    np.testing.assert_allclose(
        places[: len(SPLIT.vertices)], SPLIT.vertices, atol=2e-6
    )  # the file's order first
    np.testing.assert_allclose(places[faces], SPLIT.vertices[SPLIT.faces], atol=2e-6)
    surface = SPLIT.surface
    assert surface is not None
    assert surface.uvs is not None
    np.testing.assert_allclose(uvs[faces] * [1, -1] + [0, 1], surface.uvs[surface.uv_faces], atol=1e-6)
    target = accessor(document, binary, garment["primitives"][1]["targets"][-1]["POSITION"])
    np.testing.assert_allclose((places + target)[faces], moving(SPLIT.vertices)[3][SPLIT.faces], atol=1e-5)


def test_seams_in_texture_space_only_split_the_animation(tmp_path: Path) -> None:
    # One vertex with two texture coordinates: PLY keeps them by corner, GLB gets a copy behind all others.
    (tmp_path / "in").mkdir()
    path = tmp_path / "in/quad.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt .5 .5\nf 1/1 2/2 3/3\nf 1/4 3/3 4/1\n"
    )
    mesh = load_mesh(path)
    save_mesh_frames(tmp_path / "out", mesh.vertices[None], mesh, "ply")
    assert_same_look(load_mesh(tmp_path / "out/frame_0000.ply").surface, mesh.surface)
    from imgtransfer.exports.seams import cut_at_seams  # noqa: PLC0415

    assert mesh.surface is not None
    seamed = cut_at_seams(mesh.surface)
    np.testing.assert_array_equal(seamed.vertices, [0, 1, 2, 3, 0])
    np.testing.assert_array_equal(seamed.faces, [[0, 1, 2], [4, 2, 3]])
    np.testing.assert_allclose(seamed.uvs, [[0, 1], [1, 1], [1, 0], [0, 1], [0.5, 0.5]])


def test_textures_are_put_into_the_animation(tmp_path: Path) -> None:
    from imgtransfer.exports.gltf import animated_glb  # noqa: PLC0415

    (tmp_path / "in").mkdir()
    cv2.imwrite(f"{tmp_path}/in/cloth.png", np.full((2, 3, 3), 200, np.uint8))
    (tmp_path / "in/m.mtl").write_text("newmtl cloth\nmap_Kd cloth.png\nnewmtl other\nmap_Kd gone.png\n")
    path = tmp_path / "in/quad.obj"
    path.write_text(
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nusemtl cloth\nf 1/1 2/1 3/1\nusemtl other\nf 1 3 4\n"
    )
    mesh = load_mesh(path)
    vertices = mesh.vertices.astype(np.float32)
    template, body = Template(vertices, mesh.faces, mesh.surface), Body(vertices, mesh.faces, vertices[None])
    clip = Clip(template, Garment(vertices[None]), body, 30.0)
    document, binary = glb(animated_glb(tmp_path / "out.glb", clip))
    (image,) = document["images"]
    view = document["bufferViews"][image["bufferView"]]
    stored = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    assert stored == (tmp_path / "in/cloth.png").read_bytes()
    with_image = [m for m in document["materials"] if "baseColorTexture" in m["pbrMetallicRoughness"]]
    assert [material["name"] for material in with_image] == ["cloth"]
    save_mesh_frames(tmp_path / "frames", vertices[None], clip.template_mesh, "obj")
    library = (tmp_path / "frames/materials.mtl").read_text()
    assert "map_Kd cloth.png" in library  # a copy of it lies beside, so that the folder may be passed on
    assert (tmp_path / "frames/cloth.png").read_bytes() == stored
    assert "map_Kd gone.png" in library
    assert (tmp_path / "frames/frame_0000.obj").read_text().startswith("mtllib materials.mtl\n")


def test_arrays_of_a_look_that_do_not_fit_are_refused() -> None:
    triangle = np.array([[0, 1, 2]])
    for arguments, message in (
        ({"uvs": np.zeros((1, 2))}, "come together"),
        ({"uvs": np.zeros((1, 2)), "uv_faces": np.array([[0, 1, 0]])}, "do not exist"),
        ({"uvs": np.zeros((1, 3)), "uv_faces": triangle * 0}, "wrong shape"),
        ({"face_materials": np.array([1]), "materials": ("one",)}, "one index of a material"),
    ):
        with pytest.raises(InputError, match=message):
            Surface(triangle, np.arange(3), **arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="does not have"):
        Surface(triangle, np.arange(2))
    with pytest.raises(InputError, match="moved vertices must have shape"):
        save_mesh_frames(Path("never"), np.zeros((1, 4, 3)), VEST, "obj")
