"""Textures come along with the meshes that use them."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip, save_clip
from imgtransfer.data.mesh_output import save_mesh_frames
from imgtransfer.data.store import DataSet
from imgtransfer.data.texture_files import bring_textures
from render import load_mesh
from render.files.textures import is_image, with_full_paths
from tests.helpers import synthetic

PNG = b"\x89PNG\r\n\x1a\n, and whatever follows"
OBJ = "mtllib shirt.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl cloth\nf 1/1 2/2 3/3\n"


def test_textures_are_copied_under_free_names_and_those_missing_are_named(tmp_path):
    for folder in ("a", "b c"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "weave.png").write_bytes(PNG + folder.encode())
    (tmp_path / "secret.key").write_text("secret")
    out = tmp_path / "out"
    out.mkdir()
    mtl = (
        f"newmtl one\nmap_Kd {tmp_path}/a/weave.png\nbump -bm 0.5 {tmp_path}/b c/weave.png\n"
        f"newmtl two\nmap_Kd {tmp_path}/a/weave.png\nmap_d {tmp_path}/gone.png\n"
        f"map_Ks {tmp_path}/secret.key\nKd 1 1 1\nmap_Ka plain.png\n"
    )
    text, missing = bring_textures(mtl, out)
    assert text == (
        "newmtl one\nmap_Kd weave.png\nbump -bm 0.5 weave-2.png\n"
        "newmtl two\nmap_Kd weave.png\nmap_d gone.png\nmap_Ks secret.key\nKd 1 1 1\nmap_Ka plain.png\n"
    )
    assert missing == [f"{tmp_path}/gone.png", f"{tmp_path}/secret.key", "plain.png"]
    assert {file.name: file.read_bytes() for file in out.iterdir()} == {
        "weave.png": PNG + b"a",
        "weave-2.png": PNG + b"b c",
    }


def test_written_frames_can_be_moved_with_their_textures(tmp_path, caplog):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/shirt.obj").write_text(OBJ)
    (tmp_path / "in/shirt.mtl").write_text("newmtl cloth\nmap_Kd weave.png\nmap_d holes.png\n")
    (tmp_path / "in/weave.png").write_bytes(PNG)
    mesh = load_mesh(tmp_path / "in/shirt.obj")
    for kind in ("obj", "ply"):
        save_mesh_frames(tmp_path / kind, mesh.vertices[None], mesh, kind)
        assert (tmp_path / kind / "weave.png").read_bytes() == PNG
        assert len(caplog.records) == 1
        assert "holes.png; put them beside the written files" in caplog.text
        caplog.clear()
    assert (tmp_path / "obj/materials.mtl").read_text() == "newmtl cloth\nmap_Kd weave.png\nmap_d holes.png\n"
    assert b"comment TextureFile weave.png" in (tmp_path / "ply/frame_0000.ply").read_bytes()
    (tmp_path / "obj").rename(tmp_path / "moved")
    assert f"map_Kd {tmp_path}/moved/weave.png" in load_mesh(tmp_path / "moved/frame_0000.obj").surface.mtl


def look(path):
    """A library that names an image."""
    return f"newmtl cloth\nmap_Kd {path}\n"


@pytest.fixture
def private(tmp_path):
    """An image of somebody's, beside the folder "set"."""
    (tmp_path / "set").mkdir()
    (tmp_path / "private.png").write_bytes(PNG)
    return tmp_path / "private.png"


def test_only_images_under_the_folder_are_found(private):
    folder = private.parent / "set"
    (folder / "own.png").write_bytes(PNG)
    (folder / "link.png").symlink_to(private)
    (folder / "twice.png").symlink_to(folder / "own.png")
    (folder / "passwords.png").symlink_to("/etc/passwd")
    assert with_full_paths(look("own.png"), folder) == look(folder / "own.png")
    assert with_full_paths(look(folder / "own.png"), folder) == look(folder / "own.png")
    assert with_full_paths(look("twice.png"), folder) == look(folder / "own.png")
    for path in ("../private.png", "link.png", "passwords.png", "x" * 5000 + ".png", "own.txt"):
        assert with_full_paths(look(path), folder) == look(path)  # stays, and is nowhere near
    assert with_full_paths(look(private), folder) == look("private.png")
    assert with_full_paths(look(private), None) == look("private.png")


@pytest.mark.parametrize(
    ("content", "name", "image"),
    [
        (PNG, "a.png", True),
        (b"\xff\xd8\xff\xe0", "a.jpg", True),
        (b"RIFF1234WEBP", "a.webp", True),
        (bytes([0, 0, 2, *[0] * 13, 24, 0]), "a.tga", True),
        (b"BEGIN PRIVATE KEY", "a.png", False),
        (b"BEGIN PRIVATE KEY AND MORE", "a.tga", False),
        (b"", "a.png", False),
    ],
)
def test_images_are_told_by_how_they_begin(tmp_path, content, name, image):
    (tmp_path / name).write_bytes(content)
    assert is_image(tmp_path / name) == image
    os.mkfifo(tmp_path / "pipe.png")
    assert not is_image(tmp_path / "pipe.png")


def with_look(path):
    clip = synthetic.tube_clip(2)
    surface = replace(load_mesh_surface(clip), mtl=look(path))
    return clip.with_surface(surface)


def load_mesh_surface(clip):
    from render.mesh.surface import Surface  # noqa: PLC0415

    count = len(clip.template.faces)
    return Surface(
        clip.template.faces,
        np.arange(len(clip.template.vertices)),
        face_materials=np.zeros(count, np.int64),
        materials=("cloth",),
    )


def test_textures_are_kept_with_a_data_set_and_a_clip_file(tmp_path):
    (tmp_path / "my weave.png").write_bytes(PNG)
    clip = with_look(tmp_path / "my weave.png")
    data = DataSet.create(tmp_path / "set")
    data.write("tube/bend", clip, split="train")
    data.write("tube/again", clip, split="train")
    (tmp_path / "my weave.png").unlink()
    (tmp_path / "set").rename(tmp_path / "moved")
    (kept,) = (tmp_path / "moved/textures").glob("*/*")
    assert (kept.name, kept.read_bytes()) == ("my-weave.png", PNG)
    clip = DataSet.open(tmp_path / "moved").read("tube/bend")
    assert clip.template.surface.mtl == look(kept)
    (tmp_path / "file").mkdir()
    save_clip(tmp_path / "file/clip.npz", clip)
    (beside,) = (tmp_path / "file/textures").glob("*/*")
    assert load_clip(tmp_path / "file/clip.npz").template.surface.mtl == look(beside)
    assert main(["import", str(tmp_path / "moved"), "--to", str(tmp_path / "new")]) == 0
    assert (
        main(["export", str(tmp_path / "new"), "--clip", "tube/bend", "--out", str(tmp_path / "frames")]) == 0
    )
    assert (tmp_path / "frames/my-weave.png").read_bytes() == PNG


def test_a_data_set_does_not_lead_to_images_elsewhere(private, capsys):
    folder = private.parent / "set"
    folder.rmdir()
    data = DataSet.create(folder)
    data.write("tube/bend", with_look("weave.png"), split="train")
    (folder / "link.png").symlink_to(private)
    file = folder / "tube/bend/zarr.json"
    stored = json.loads(file.read_text())
    for number, path in enumerate((private, folder / "link.png", "link.png", "../private.png")):
        stored["attributes"]["info"]["mtl"] = look(path)
        file.write_text(json.dumps(stored))
        out = private.parent / f"frames{number}"
        assert main(["export", str(folder), "--clip", "tube/bend", "--out", str(out)]) == 0
        assert not [*out.glob("*.png")]
        assert ".png; put them beside the written files" in capsys.readouterr().err
        glb = private.parent / f"{number}.glb"
        assert main(["export", str(folder), "--clip", "tube/bend", "--out", str(glb)]) == 0
        assert PNG not in glb.read_bytes()
