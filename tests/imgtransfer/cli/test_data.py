"""The commands on clips and data sets, and one clear line for each bad input."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from imgtransfer.cli import machine
from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.store import DataSet
from imgtransfer.evaluation.metrics import METRICS
from render import load_maps, save_maps
from tests.helpers.clips import assert_same_clip


@pytest.fixture
def data(tmp_path: Path, tube_clip: Clip) -> Path:
    """A data set with clips tube/bend (train) and tube/short (test)."""
    save_clip(tmp_path / "in/tube_bend.npz", tube_clip)
    save_clip(tmp_path / "in/tube_short.npz", tube_clip.slice(slice(0, 4)))
    for name, split in (("bend", "train"), ("short", "test")):
        assert (
            main(["import", f"{tmp_path}/in/tube_{name}.npz", "--to", f"{tmp_path}/ds", "--split", split])
            == 0
        )
    return tmp_path / "ds"


def one_error_line(capsys: pytest.CaptureFixture[str], *argv: object) -> str:
    """Run a command that must fail: exit status 2, one line on stderr, nothing on stdout."""
    capsys.readouterr()
    assert main([str(arg) for arg in argv]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("imgtransfer: error: ")
    assert err.count("\n") == 1
    return err


def broken_clip(path: Path, source: Path, **arrays: np.ndarray) -> Path:
    with np.load(source) as stored:
        np.savez(path, **{**{key: stored[key] for key in stored.files}, **arrays})
    return path


# import and export


def test_import_and_export_lose_nothing(tmp_path: Path, data: Path, tube_clip: Clip) -> None:
    assert DataSet.open(data).names("test") == ["tube/short"]
    assert main(["export", str(data), "--clip", "tube/bend", "--out", f"{tmp_path}/out/bend.npz"]) == 0
    assert_same_clip(load_clip(tmp_path / "out/bend.npz"), tube_clip)


def test_import_of_a_folder_into_a_named_garment(tmp_path: Path, data: Path) -> None:
    assert (
        main(["import", f"{tmp_path}/in", "--to", f"{tmp_path}/new", "--split", "train", "--garment", "t"])
        == 0
    )
    assert DataSet.open(tmp_path / "new").names() == ["t/tube_bend", "t/tube_short"]
    assert data.exists()


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_export_of_frames_keeps_the_vertex_order(
    tmp_path: Path, data: Path, tube_clip: Clip, kind: str
) -> None:
    out = tmp_path / "frames"
    assert (
        main(
            [
                "export",
                str(data),
                "--clip",
                "tube/short",
                "--out",
                str(out),
                "--frames-as",
                kind,
                "--step",
                "3",
            ]
        )
        == 0
    )
    assert sorted(file.name for file in out.iterdir()) == [
        f"{name}.{kind}"
        for name in ("body_0000", "body_0003", "body_rest", "garment_0000", "garment_0003", "template")
    ]
    mesh = trimesh.load(out / f"garment_0003.{kind}", process=False)
    np.testing.assert_allclose(mesh.vertices, tube_clip.garment.vertices[3], atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, tube_clip.template.faces)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_exported_frames_are_imported_again(tmp_path: Path, data: Path, tube_clip: Clip, kind: str) -> None:
    out = tmp_path / "bend"
    assert main(["export", str(data), "--clip", "tube/bend", "--out", str(out), "--frames-as", kind]) == 0
    back = f"{tmp_path}/back.zarr"
    assert (
        main(["import", "meshes", str(out), "--to", back, "--split", "test", "--garment", "tube", "--anyway"])
        == 0
    )
    clip = DataSet.open(back).read("tube/bend")
    for key in ("template_vertices", "garment_vertices", "body_rest", "body_vertices"):
        assert np.allclose(clip.arrays()[key], tube_clip.arrays()[key], rtol=0, atol=1e-6), key


def test_export_of_an_animation(tmp_path: Path, data: Path) -> None:
    assert main(["export", str(data), "--clip", "tube/short", "--out", f"{tmp_path}/short.glb"]) == 0
    assert set(trimesh.load(tmp_path / "short.glb").geometry) == {"body", "garment"}


def test_export_refuses_unknown_endings_and_folders_in_use(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "ends in .npz, .glb, .usd" in one_error_line(
        capsys, "export", data, "--clip", "tube/bend", "--out", tmp_path / "a.fbx"
    )
    assert "exists already" in one_error_line(
        capsys, "export", data, "--clip", "tube/bend", "--out", tmp_path / "in"
    )
    assert "no clip matches" in one_error_line(
        capsys, "export", data, "--clip", "dress/bend", "--out", tmp_path / "a.npz"
    )
    assert not (tmp_path / "a.npz").exists()


# evaluate


def test_evaluate_prints_exactly_the_metrics_as_json(
    tmp_path: Path, data: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, shift in (("bend", 0.003), ("short", 0.006)):
        clip = load_clip(tmp_path / f"in/tube_{name}.npz")
        moved = clip.with_garment(clip.garment.vertices + np.float32([0, shift, 0]))
        save_clip(tmp_path / f"out/tube__{name}/fused.npz", moved)
    capsys.readouterr()
    assert main(["evaluate", f"{tmp_path}/out", "--truth", str(data), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"clips", "overall", "config"}
    assert found["config"]["sted"]["frame_step"] == 0.002
    assert set(found["clips"]) == {"tube/bend", "tube/short"}
    for values in (*found["clips"].values(), found["overall"]):
        assert tuple(values) == METRICS
    assert found["clips"]["tube/bend"]["rmse_mm"] == pytest.approx(3, abs=1e-3)
    assert found["overall"]["rmse_mm"] == pytest.approx((6 * 3 + 4 * 6) / 10, abs=1e-3)  # by frames


def test_evaluate_takes_the_fused_result_where_there_are_both(
    tmp_path: Path, data: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    worse = tube_clip.with_garment(tube_clip.garment.vertices + np.float32([0, 0.01, 0]))
    save_clip(tmp_path / "out/tube__bend/fused.npz", tube_clip)
    save_clip(tmp_path / "out/tube__bend/position_only.npz", worse)
    for options, wanted in (([], 0), (["--method", "position_only"], 10)):
        capsys.readouterr()
        assert main(["evaluate", f"{tmp_path}/out", "--truth", str(data), "--json", *options]) == 0
        assert json.loads(capsys.readouterr().out)["overall"]["rmse_mm"] == pytest.approx(wanted, abs=1e-3)


def test_evaluate_pairs_two_files_and_shows_a_table(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture
) -> None:
    save_clip(tmp_path / "mine.npz", load_clip(tmp_path / "in/tube_bend.npz"))
    capsys.readouterr()
    assert main(["evaluate", f"{tmp_path}/mine.npz", "--truth", f"{tmp_path}/in/tube_bend.npz"]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[0].split()[0] == "clip"
    assert table[-1].split() == ["overall", "0.00", "0.00", "0.00", *["0.0000"] * 3, *["0.000"] * 3]
    assert data.exists()


def test_evaluate_says_the_parameters_that_it_was_given(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ten times the step between frames: the temporal part falls, the spatial one stays."""
    (tmp_path / "sted.yaml").write_text("sted: {frame_step: 0.02}\n")
    found = {}
    for options in ([], ["--config", f"{tmp_path}/sted.yaml"], ["--set", "sted.frame_step=0.02"]):
        capsys.readouterr()
        assert main(["evaluate", "--baseline", "lbs", "--truth", str(data), "--json", *options]) == 0
        printed = json.loads(capsys.readouterr().out)
        found[printed["config"]["sted"]["frame_step"]] = printed["overall"]
    assert found[0.02]["sted_temporal"] < 0.8 * found[0.002]["sted_temporal"]
    assert found[0.02]["sted_spatial"] == found[0.002]["sted_spatial"]


def test_evaluate_measures_the_baseline(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["evaluate", "--baseline", "lbs", "--truth", str(data), "--split", "test", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found["clips"]) == ["tube/short"]
    assert 1 < found["overall"]["rmse_mm"] < 10


def test_evaluate_says_what_it_lacks(
    tmp_path: Path, data: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "either predictions or --baseline" in one_error_line(capsys, "evaluate", "--truth", data)
    assert "no such file" in one_error_line(capsys, "evaluate", tmp_path / "absent", "--truth", data)
    assert "no prediction in it" in one_error_line(capsys, "evaluate", data / "tube", "--truth", data)
    save_clip(tmp_path / "other.npz", tube_clip)
    assert "no truth for the prediction of other" in one_error_line(
        capsys, "evaluate", tmp_path / "other.npz", "--truth", data
    )
    np.savez(tmp_path / "other.npz", faces=tube_clip.template.faces)
    assert "predicts nothing" in one_error_line(
        capsys, "evaluate", tmp_path / "other.npz", "--truth", tmp_path / "in/tube_bend.npz"
    )
    save_clip(tmp_path / "out/tube__bend/fused.npz", tube_clip.slice(slice(0, 2)))
    assert "not the same clip" in one_error_line(capsys, "evaluate", tmp_path / "out", "--truth", data)
    bare = replace(tube_clip, skeleton=replace(tube_clip.skeleton, blend_weights=None))
    save_clip(tmp_path / "bare.npz", bare)
    assert "no skinning" in one_error_line(
        capsys, "evaluate", "--baseline", "lbs", "--truth", tmp_path / "bare.npz"
    )


# inspect and doctor


def test_inspect_summarises_data_sets_clips_and_maps(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["inspect", str(data)]) == 0
    text = capsys.readouterr().out
    assert "2 clips, 10 frames" in text
    row = next(line for line in text.splitlines() if line.startswith("tube/short")).split()
    assert row[:6] == ["tube/short", "test", "4", "30", "192/352", "128/252"]
    assert float(row[-1]) == 0.0
    assert "by front,back: front" in text
    assert "% with layer 1" in text
    assert main(["inspect", f"{tmp_path}/in/tube_bend.npz"]) == 0
    assert "1 clips, 6 frames" in capsys.readouterr().out
    assert main(["render", f"{tmp_path}/in/tube_bend.npz", "--out", f"{tmp_path}/m", "--size", "32"]) == 0
    assert main(["inspect", f"{tmp_path}/m/tube_bend/garment.npz"]) == 0
    text = capsys.readouterr().out
    assert "32 x 32 pixels" in text
    assert "off the skin" not in text  # nobody knows
    maps = load_maps(tmp_path / "m" / "tube_bend" / "garment.npz")
    save_maps(tmp_path / "known.npz", replace(maps, contact_offset_m=0.0043))
    assert main(["inspect", f"{tmp_path}/known.npz"]) == 0
    assert "cloth rests 4.3 mm off the skin" in capsys.readouterr().out


def test_inspect_counts_the_numbers_of_a_checkpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from safetensors.numpy import save_file  # noqa: PLC0415

    tensors = {"encoder.a.weight": np.zeros((4, 5), np.float32), "decoder.b": np.zeros(7, np.float32)}
    save_file(tensors, tmp_path / "model.safetensors", metadata={"steps": "12"})
    for source in (tmp_path, tmp_path / "model.safetensors"):
        assert main(["inspect", str(source)]) == 0
        text = capsys.readouterr().out
        assert "2 tensors, 27 numbers (F32)" in text
        assert "steps: 12" in text
    (tmp_path / "model.safetensors").write_bytes(b"junk")
    assert "not a readable safetensors" in one_error_line(capsys, "inspect", tmp_path)


def test_doctor_finds_this_machine_usable(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "ready"
    found = {line.split()[0]: line for line in lines[:-1]}
    assert set(found) >= {"python", "GL", "torch", "vectors", "bfloat16", "threads", "warp", "newton", "anny"}
    assert torch.backends.cpu.get_cpu_capability() in found["vectors"]
    assert re.search(r"[\d.]+ times as long as float32; .* take (float32|bfloat16)$", found["bfloat16"])
    assert re.search(rf"torch {torch.get_num_threads()}\b.* OMP_WAIT_POLICY=", found["threads"])


def test_doctor_names_the_processors_vector_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cpuinfo").write_text("model name\t: any\nflags\t\t: fpu avx2 avx512f amx_bf16 amx_tile\n")
    monkeypatch.setattr(machine, "CPU_INFO", tmp_path / "cpuinfo")
    assert machine.vector_units().startswith("AVX2, AVX-512, AMX BF16; torch uses ")


# bad input: one line, exit status 2, nothing half-written


@pytest.mark.parametrize("command", ["render", "inspect", "import", "export"])
def test_a_missing_file(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    options = {
        "render": ["--out", tmp_path / "out"],
        "inspect": [],
        "import": ["--to", tmp_path / "out", "--split", "train"],
        "export": ["--clip", "tube/bend", "--out", tmp_path / "out"],
    }
    err = one_error_line(capsys, command, tmp_path / "absent.npz", *options[command])
    assert "absent.npz: no such file" in err
    assert not (tmp_path / "out").exists()


BAD_ARRAYS = {
    "face index out of range": (
        {"garment_faces": np.array([[0, 1, 999]])},
        "face 0 uses vertices [0, 1, 999]",
    ),
    "no faces": ({"garment_faces": np.zeros((0, 3), np.int64)}, "no faces"),
    "non-finite vertices": ({"body_vertices": np.full((6, 128, 3), np.nan, np.float32)}, "not finite"),
}


@pytest.mark.parametrize("case", BAD_ARRAYS)
@pytest.mark.parametrize("command", ["render", "import"])
def test_bad_meshes(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture, case: str, command: str
) -> None:
    arrays, message = BAD_ARRAYS[case]
    path = broken_clip(tmp_path / "bad.npz", tmp_path / "in/tube_bend.npz", **arrays)
    before = DataSet.open(data).names()
    options = ["--out", tmp_path / "out"] if command == "render" else ["--to", data, "--split", "train"]
    assert message in one_error_line(capsys, command, path, *options)
    assert not (tmp_path / "out").exists()
    assert DataSet.open(data).names() == before


def test_a_bad_clip_among_good_ones_imports_none(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = broken_clip(
        tmp_path / "bad.npz", tmp_path / "in/tube_bend.npz", garment_faces=np.array([[0, 1, 999]])
    )
    err = one_error_line(
        capsys, "import", tmp_path / "in/tube_bend.npz", path, "--to", tmp_path / "new", "--split", "train"
    )
    assert "bad" in err
    assert not (tmp_path / "new").exists()
    assert data.exists()


def test_a_data_set_of_another_version(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = json.loads((data / "zarr.json").read_text())
    stored["attributes"]["schema_version"] = 3
    (data / "zarr.json").write_text(json.dumps(stored))
    for argv in (("inspect", data), ("render", data, "--out", tmp_path / "out")):
        err = one_error_line(capsys, *argv)
        assert "schema version 3" in err
        assert "versions 1 and 2" in err


def test_a_garment_outside_the_view(tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    far = np.float32([[50, 0, 0]])
    with np.load(tmp_path / "in/tube_bend.npz") as stored:
        rest = stored["body_rest"] + far
    path = broken_clip(tmp_path / "far.npz", tmp_path / "in/tube_bend.npz", body_rest=rest)
    assert "outside the view" in one_error_line(capsys, "render", path, "--out", tmp_path / "out")
    assert list((tmp_path / "out").glob("*")) == []
    assert data.exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--size", "0"], "--size 0"),
        (["--size", "3x4x5"], "--size 3x4x5"),
        (["--views", "front,top"], "views must be"),
        (["--frames", "a:b"], "--frames a:b"),
        (["--frames", "40:50"], "none of these"),
        (["--split", "validation"], "no clip matches (split validation)"),
    ],
)
def test_bad_options(
    tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert message in one_error_line(capsys, "render", data, "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()
