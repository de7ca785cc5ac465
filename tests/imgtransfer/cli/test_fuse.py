"""`imgtransfer fuse` and what stands behind it, on files."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fusion import fuse_maps
from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip, save_clip
from render import MapFile, load_maps, load_mesh
from tests.helpers.fusion_examples import tube, write_example

FRAMES = 2
QUICK = "edge_iterations: 3\nnormal_iterations: 3\n"


@pytest.fixture
def folder(tmp_path):
    """What `write_example` writes."""
    write_example(tmp_path, FRAMES)
    (tmp_path / "fusion.yaml").write_text(QUICK)
    return tmp_path


def command(folder, *more, out="out"):
    return main(["fuse", "--maps", str(folder / "maps.npz"), "--out", str(folder / out), *map(str, more)])


def error_mm(path, folder):
    with np.load(path) as found:
        return (
            1000
            * np.linalg.norm(
                found["garment_vertices"] - load_clip(folder / "clip.npz").garment.vertices, axis=-1
            ).mean()
        )


def test_a_clip_s_body_gives_a_clip_with_the_fused_garment_in_the_world(folder, capsys):
    assert command(folder, "--body", folder / "clip.npz") == 0
    clip = load_clip(folder / "out" / "fused.npz")
    assert clip.info["licence"] == "CC0"
    np.testing.assert_array_equal(clip.body.vertices, load_clip(folder / "clip.npz").body.vertices)
    assert (
        error_mm(folder / "out" / "fused.npz", folder) < 2.5
    )  # a pixel is 7 mm; through two frames of reference
    report = json.loads((folder / "out" / "fusion.json").read_text())
    assert report["frames"] == FRAMES
    assert report["penetration_percent"]["after"] == 0
    assert report["config"]["weight_edge"] == 100
    assert str(folder / "out") in capsys.readouterr().out
    assert sorted(path.name for path in (folder / "out").iterdir()) == ["fused.npz", "fusion.json"]


def test_a_bare_body_and_no_body(folder):
    quick = ("--config", folder / "fusion.yaml")
    assert command(folder, "--body", folder / "body.npz", *quick, out="with") == 0
    assert command(folder, *quick, out="without") == 0
    keys = {"template_vertices", "garment_faces", "garment_vertices", "fps"}
    with np.load(folder / "with" / "fused.npz") as found:
        assert set(found.files) == keys | {"body_faces", "body_vertices"}
    with np.load(folder / "without" / "fused.npz") as found:
        assert set(found.files) == keys
        assert found["fps"] == 30
    assert "penetration_percent" not in json.loads((folder / "without" / "fusion.json").read_text())


def test_positions_only_leaves_the_normals_out(folder):
    assert command(folder, "--positions-only", "--config", folder / "fusion.yaml") == 0
    assert set(json.loads((folder / "out" / "fusion.json").read_text())["terms"]) == {"edge"}


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_mesh_files_keep_vertices_and_faces(folder, suffix):
    assert command(folder, "--meshes", suffix, "--config", folder / "fusion.yaml") == 0
    files = sorted((folder / "out" / "meshes").iterdir())
    assert [path.name for path in files] == [f"frame_000{i}.{suffix}" for i in range(FRAMES)]
    with np.load(folder / "out" / "fused.npz") as found:
        for path, vertices in zip(files, found["garment_vertices"], strict=True):
            mesh = load_mesh(path)
            np.testing.assert_array_equal(mesh.faces, found["garment_faces"])
            np.testing.assert_allclose(mesh.vertices, vertices, atol=1e-6)


def test_the_template_may_come_from_a_file(folder):
    quick = ("--config", folder / "fusion.yaml")
    assert command(folder, "--template", folder / "template.obj", *quick, out="given") == 0
    assert command(folder, *quick, out="stored") == 0
    with np.load(folder / "given" / "fused.npz") as given, np.load(folder / "stored" / "fused.npz") as stored:
        np.testing.assert_allclose(given["garment_vertices"], stored["garment_vertices"], atol=1e-5)


def test_files_in_other_axes_and_units_give_the_same(folder):
    """Template, body and start as mesh files in centimetres and z up, against the same in metres and y up."""
    clip, quick = load_clip(folder / "clip.npz"), ("--config", folder / "fusion.yaml")
    for place, change in (("plain", lambda v: v), ("other", lambda v: 100 * v[:, [0, 2, 1]] * [1, -1, 1])):
        for name, faces, frames in (
            ("template", clip.template.faces, clip.template.vertices[None]),
            ("body", clip.body.faces, clip.body.vertices),
            ("initial", clip.template.faces, clip.garment.vertices),
        ):
            (folder / place / name).mkdir(parents=True)
            for k, vertices in enumerate(frames):
                trimesh.Trimesh(change(vertices), faces, process=False).export(
                    folder / place / name / f"{k}.ply"
                )
        files = ["--template", folder / place / "template/0.ply"]
        files += [word for name in ("body", "initial") for word in (f"--{name}", folder / place / name)]
        axes = ("--up=z", "--unit=cm") if place == "other" else ()
        assert command(folder, *files, *quick, *axes, out=f"out-{place}") == 0
    with np.load(folder / "out-plain/fused.npz") as plain, np.load(folder / "out-other/fused.npz") as other:
        for key in ("template_vertices", "body_vertices", "garment_vertices"):
            np.testing.assert_allclose(other[key], plain[key], atol=1e-5)


def test_a_split_template_is_welded_for_maps_of_the_welded_one(folder, tmp_path):
    """Every triangle its own vertices: what is written has them again, and seams stay closed."""
    mesh, quick = load_mesh(folder / "template.obj"), ("--config", folder / "fusion.yaml")
    clip = load_clip(folder / "clip.npz")
    corners = mesh.faces.reshape(-1)
    trimesh.Trimesh(mesh.vertices[corners], np.arange(len(corners)).reshape(-1, 3), process=False).export(
        tmp_path / "split.ply"
    )
    np.savez(tmp_path / "start.npz", garment_faces=np.arange(len(corners)).reshape(-1, 3),
             garment_vertices=clip.garment.vertices[:, corners])  # fmt: skip
    (tmp_path / "pins.txt").write_text(" ".join(str(k) for k in np.flatnonzero(corners < 3)))
    given = ("--template", tmp_path / "split.ply", "--weld", "--initial", tmp_path / "start.npz")
    assert command(folder, *given, "--pins", tmp_path / "pins.txt", *quick, "--meshes", "ply") == 0
    with np.load(folder / "out/fused.npz") as found:
        assert len(found["template_vertices"]) == len(mesh.vertices) < len(corners)
        held = np.linalg.norm(
            found["garment_vertices"][0][:, None] - clip.garment.vertices[0][:3], axis=-1
        ).min(0)
        np.testing.assert_allclose(held, 0, atol=1e-6)
    written = load_mesh(sorted((folder / "out/meshes").iterdir())[0])
    assert len(written.vertices) == len(corners)
    assert np.unique(written.vertices.round(7), axis=0).shape[0] == len(mesh.vertices)


def test_options_that_would_do_nothing_are_refused(folder, capsys):
    mesh = ("--template", folder / "template.obj")
    for options, message in (
        (("--unit=cm",), "--unit does nothing here: it goes with mesh files"),
        (("--body", folder / "clip.npz", "--up=z"), "--up does nothing here"),
        ((*mesh, "--unit=cm", "--garment-unit=cm"), "--unit does nothing here"),
        ((*mesh, "--scale=2", "--garment-unit=cm"), "--scale does nothing here"),
        (("--weld",), "--weld goes with --template"),
        ((*mesh, "--unit=cm", "--scale=2"), "--unit and --scale say the same"),
    ):
        assert command(folder, *options) == 2
        assert message in capsys.readouterr().err
    assert main(["fuse", str(folder), "--weld"]) == 2
    assert "--weld goes with --maps" in capsys.readouterr().err


def test_an_earlier_result_is_replaced_and_other_files_are_not(folder, capsys):
    quick = ("--config", folder / "fusion.yaml")
    assert command(folder, *quick) == 0
    assert command(folder, *quick) == 0
    (folder / "out" / "thesis.txt").write_text("precious")
    assert command(folder, *quick) == 2
    assert "holds other files" in capsys.readouterr().err
    assert (folder / "out" / "thesis.txt").read_text() == "precious"


def spoil_body(folder, **changed):
    with np.load(folder / "body.npz") as stored:
        arrays = {**stored, **changed}
    np.savez(folder / "bad.npz", **{name: value for name, value in arrays.items() if value is not None})
    return ("--body", folder / "bad.npz")


# a folder of predictions


@pytest.fixture
def predictions(folder):
    """What `predict` writes: folders a and b; the clip has skinning arrays and a garment that is not yet right."""
    clip = load_clip(folder / "clip.npz")
    weights = np.full((len(clip.body.rest), 2), 0.5, np.float32)
    clip = replace(
        clip,
        skeleton=replace(clip.skeleton, blend_weights=weights, poses=np.zeros((FRAMES, 2, 3), np.float32)),
    )
    for name in ("a", "b"):
        save_clip(folder / "p" / name / "position_only.npz", clip)
        shutil.copy(folder / "maps.npz", folder / "p" / name)
    return folder / "p"


def fuse(path, *more):
    config = path.parent / "fusion.yaml"
    return main(["fuse", str(path), *(("--config", str(config)) if config.exists() else ()), *map(str, more)])


def test_predictions_are_fused_in_their_folders_and_only_once(folder, predictions, capsys):
    assert fuse(predictions) == 0
    assert (
        capsys.readouterr().out.splitlines()[-1]
        == f"next     imgtransfer evaluate {predictions} --truth SOURCE"
    )
    for name in ("a", "b"):
        files = sorted(path.name for path in (predictions / name).iterdir())
        assert files == ["fused.npz", "fusion.json", "maps.npz", "position_only.npz"]
        assert error_mm(predictions / name / "fused.npz", folder) < 10
        fused = load_clip(predictions / name / "fused.npz")
        assert fused.skeleton.blend_weights.shape == (len(fused.body.rest), 2)
        assert fused.skeleton.poses.shape == (FRAMES, 2, 3)
        assert json.loads((predictions / name / "fusion.json").read_text())["config"]["edge_iterations"] == 3

    def again(*more, where=predictions):
        """The folders that another run fuses."""
        before = {name: (predictions / name / "fused.npz").stat().st_ino for name in ("a", "b")}
        assert fuse(where, *more) == 0
        written = {n for n in before if (predictions / n / "fused.npz").stat().st_ino != before[n]}
        assert capsys.readouterr().out.count("fused already") == (2 if where == predictions else 1) - len(
            written
        )
        return written

    assert again() == set()
    assert again("--positions-only") == {"a", "b"}
    assert set(json.loads((predictions / "a" / "fusion.json").read_text())["terms"]) == {"edge", "normal"}
    (folder / "fusion.yaml").write_text("edge_iterations: 4\nnormal_iterations: 3\n")
    assert again() == {"a", "b"}
    assert again("--overwrite") == {"a", "b"}
    (predictions / "b" / "fused.npz").write_bytes(b"cut short")
    assert again() == {"b"}
    later = (predictions / "a" / "fused.npz").stat().st_mtime_ns + 1
    os.utime(predictions / "a" / "maps.npz", ns=(later, later))
    assert again() == set()  # the same maps, only touched
    with np.load(predictions / "a" / "maps.npz") as maps:
        arrays = dict(maps)
    arrays["position"][arrays["position"] > 0] *= 0.999
    np.savez(predictions / "a" / "maps.npz", **arrays)
    assert again() == {"a"}
    assert again() == set()
    clip = load_clip(predictions / "b" / "position_only.npz")
    save_clip(
        predictions / "b" / "position_only.npz",
        replace(clip, body=replace(clip.body, vertices=clip.body.vertices + np.float32(1e-4))),
    )
    assert again() == {"b"}
    shutil.copy(folder / "fusion.yaml", predictions)
    assert again("--overwrite", where=predictions / "a") == {"a"}


def test_a_fusion_of_an_earlier_version_which_kept_no_fingerprint_is_done_again(predictions):
    assert fuse(predictions) == 0
    fused = predictions / "a" / "fused.npz"
    clip = load_clip(fused)
    del clip.info["made"]
    save_clip(fused, clip)
    before = {name: (predictions / name / "fused.npz").stat().st_ino for name in ("a", "b")}
    assert fuse(predictions) == 0
    assert fused.stat().st_ino != before["a"]
    assert (predictions / "b" / "fused.npz").stat().st_ino == before["b"]
    assert load_clip(fused).info["made"]


def test_meshes_of_predictions_that_stand_are_written_without_fusing_again(predictions):
    assert fuse(predictions) == 0
    before = (predictions / "a" / "fused.npz").stat().st_ino
    assert fuse(predictions, "--meshes", "ply") == 0
    assert (predictions / "a" / "fused.npz").stat().st_ino == before
    mesh = load_mesh(predictions / "a" / "meshes" / "frame_0001.ply")
    fused = load_clip(predictions / "a" / "fused.npz")
    np.testing.assert_allclose(mesh.vertices, fused.garment.vertices[1], atol=1e-6)


def test_a_stopped_fusion_goes_on(predictions, capsys, monkeypatch):
    import imgtransfer.pipeline.fuse as module  # noqa: PLC0415

    real = module.fuse_map_parts

    def stop_at_b(*args, **kwargs):
        if (predictions / "a" / "fused.npz").exists():
            raise KeyboardInterrupt
        return real(*args, **kwargs)

    monkeypatch.setattr(module, "fuse_map_parts", stop_at_b)
    assert fuse(predictions) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "imgtransfer: stopped"
    assert sorted(path.name for path in (predictions / "b").iterdir()) == ["maps.npz", "position_only.npz"]
    before = (predictions / "a" / "fused.npz").stat().st_ino
    monkeypatch.undo()
    assert fuse(predictions) == 0
    assert (predictions / "a" / "fused.npz").stat().st_ino == before
    assert (predictions / "b" / "fused.npz").exists()


def test_what_is_no_prediction_is_refused(folder, predictions, capsys):
    (folder / "empty").mkdir()
    for arguments, message in (
        ([folder / "none"], "none: no such folder"),
        ([folder / "maps.npz"], "give --maps FILE --out DIR"),
        ([folder / "empty"], "no prediction in it"),
        ([], "either PREDICTIONS or --maps"),
        ([predictions, "--maps", folder / "maps.npz"], "either PREDICTIONS or --maps"),
        ([predictions, "--out", folder / "out"], "--out goes with --maps"),
        (["--maps", folder / "maps.npz"], "--maps needs --out"),
        (["--maps", folder / "maps.npz", "--out", folder / "out", "--overwrite"], "--overwrite goes with"),
    ):
        assert main(["fuse", *map(str, arguments)]) == 2
        assert message in capsys.readouterr().err
    (predictions / "b" / "position_only.npz").unlink()
    assert fuse(predictions) == 2
    assert "b: lacks position_only.npz" in capsys.readouterr().err
    assert not (predictions / "a" / "fused.npz").exists()


MISTAKES = {
    "no maps": (lambda f: ("--maps", f / "none.npz"), "none.npz: no such file"),
    "no body": (lambda f: ("--body", f / "none.npz"), "none.npz: no such file"),
    "body is text": (lambda f: ("--body", f / "fusion.yaml"), "not a readable npz"),
    "body without faces": (lambda f: spoil_body(f, body_faces=None), "lacks body_faces"),
    "body of other length": (
        lambda f: spoil_body(f, body_vertices=np.zeros((5, 98, 3))),
        "as the maps have 2",
    ),
    "body face out of range": (lambda f: spoil_body(f, body_faces=np.array([[0, 1, 9999]])), "9999"),
    "body not finite": (lambda f: spoil_body(f, body_vertices=np.full((2, 98, 3), np.nan)), "not finite"),
    "no such config": (lambda f: ("--config", f / "none.yaml"), "none.yaml"),
    "no such device": (lambda f: ("--device", "tpu9"), "--device tpu9"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line_and_leaves_nothing(folder, capsys, name):
    arguments, message = MISTAKES[name]
    assert command(folder, *arguments(folder)) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "out").exists()
    assert not list(folder.glob(".out*"))


def test_a_template_that_does_not_fit_the_maps(folder, capsys):
    path = folder / "template.obj"
    kept = path.read_text()
    path.write_text(kept + "v 0 0 0\n")
    assert command(folder, "--template", path) == 2
    assert "545 vertices, but the maps were made with a template of 544" in capsys.readouterr().err
    wider = [f"v {1.3 * x} {y} {1.3 * z}" for x, y, z in tube().vertices]
    path.write_text("\n".join(wider + [line for line in kept.splitlines() if line.startswith("f")]))
    assert command(folder, "--template", path) == 2
    assert "outside the maps' silhouette" in capsys.readouterr().err


def test_maps_without_positions_say_so(folder, capsys):
    with np.load(folder / "maps.npz") as stored:
        arrays = {name: stored[name] for name in stored.files if name != "position"}
    np.savez(folder / "maps.npz", **arrays)
    assert command(folder) == 2
    assert "no position maps" in capsys.readouterr().err


def test_single_outline_pixels_that_another_rasteriser_lacks_are_filled(folder):
    maps = load_maps(folder / "maps.npz")
    row, column = np.argwhere(maps.mask[0])[0]
    arrays = {name: getattr(maps, name) for name in maps.__dataclass_fields__}
    for name in ("mask", "position", "normal"):
        arrays[name] = arrays[name].copy()
    arrays["mask"][0, row, column] = False
    arrays["position"][:, 0, row, column] = arrays["normal"][:, 0, row, column] = 0
    whole, lacking = fuse_maps(maps), fuse_maps(MapFile(**arrays))
    assert np.abs(whole.vertices - lacking.vertices).max() < 0.01
