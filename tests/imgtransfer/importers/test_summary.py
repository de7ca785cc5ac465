"""What was taken, in words: what a user reads before the work, and what --dry-run stops at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import save_clip
from imgtransfer.importers.checks.axes import Axes, MotionAxes
from imgtransfer.importers.summary import (
    Summary,
    clip_summary,
    lying_facts,
    mesh_text,
    motion_text,
    rate_text,
    size_text,
    told,
)
from render import Mesh, MeshSequence
from render.mesh.file_axes import FileAxes
from tests.helpers import synthetic
from tests.helpers.import_examples import split, standing_body, vest, write_mdd, write_obj
from tests.helpers.synthetic import tube_clip

BODY = standing_body()
VEST = vest(BODY)


def test_each_summary_says_what_differs_from_the_one_before() -> None:
    first = Summary("a/one", (("garment", "10 vertices"), ("rate", "30 a second")))
    second = Summary("a/two", (("garment", "12 vertices"), ("rate", "30 a second")))
    assert told([first, second]).splitlines() == [
        "a/one",
        "  garment  10 vertices",
        "  rate     30 a second",
        "a/two",
        "  garment  12 vertices",
        "  rate as above",
    ]
    assert told([]) == ""


def test_a_line_stays_a_line_whatever_names_hold() -> None:
    assert len(told([Summary("a\nb", (("from", "x\ny"),))]).splitlines()) == 2


def test_where_the_rate_comes_from() -> None:
    assert rate_text(24.0, 25.0, 30.0) == "24 a second, given"
    assert rate_text(None, 25.0, 30.0) == "25 a second, from the file"
    assert rate_text(None, None, 30.0) == "30 a second, assumed: the files do not say it (fps does)"


def test_where_units_and_axes_come_from() -> None:
    assert lying_facts(BODY, Axes()) == [
        ("units", "metres, assumed"),
        ("axes", "y up, facing z, as the body's shape tells"),
    ]
    tube = Mesh(*synthetic.tube(0.15, 1.0, 9, 14, closed=True))
    assert lying_facts(tube, Axes())[1] == ("axes", "y up, facing z, assumed: the body's shape does not tell")
    rest = Axes("z", "-y", 0.01)
    given = lying_facts(
        tube, rest, {"garment": Axes("x", "z", 0.5), "frames": MotionAxes(up="y").beside(rest)}
    )
    assert given == [
        ("units", "cm, given"),
        ("axes", "z up, facing -y, given: the body's shape does not tell"),
        ("garment in", "0.5 m a unit, x up, facing z, given"),
        ("frames in", "cm, y up, facing z, given"),
    ]
    assert lying_facts(None, Axes())[1] == ("axes", "y up, facing z, assumed")


def test_units_and_axes_that_a_file_states_are_told_as_the_file_s() -> None:
    said = Axes().of_file(FileAxes("z", 0.01))
    assert lying_facts(BODY, said, {"frames": said, "garment": None}) == [
        ("units", "cm, from the file"),
        ("axes", "z up, facing -y, from the file"),
    ]
    in_metres = Axes("y", "z", 1.0, frozenset({"up"})).of_file(FileAxes("z", 1.0))
    assert lying_facts(None, in_metres, {"frames": said}) == [
        ("units", "metres, from the file"),
        ("axes", "y up, facing z, given"),
        ("frames in", "cm, z up, facing -y, from the file"),
    ]


def test_what_a_mesh_is_made_of() -> None:
    parts = split(VEST)
    text = mesh_text(parts, joined=7)
    assert text.startswith(f"{len(parts.vertices)} vertices, {len(parts.faces)} triangles, 7 vertices joined")
    assert text.endswith("UVs, materials front, side panel")
    assert mesh_text(VEST).endswith("no UVs, no materials")
    square = Mesh(np.array([[0.0, 0, 0], [2, 1, 0], [0, 1, 0.5], [99, 99, 99]]), np.array([[0, 1, 2]]))
    assert size_text(square) == "1.00 m high, 2.00 m wide, 0.50 m deep"


def test_where_frames_come_from() -> None:
    moving = MeshSequence.of_array(VEST, VEST.vertices[None], source="x")
    assert motion_text(moving) == "x: 1 frame, at rest as in vest.obj"
    first = Mesh(VEST.vertices, VEST.faces, "in/f_1.obj")
    named = replace(
        MeshSequence.of_array(first, np.repeat(VEST.vertices[None], 2, axis=0), source="in"),
        frame_names=["f_1.obj", "f_2.obj"],
    )
    assert motion_text(named) == "in: 2 frames (f_1.obj to f_2.obj), at rest as in the first frame"


def test_a_clip_that_was_read() -> None:
    clip = tube_clip(5)
    assert ("frames", f"5 at {clip.fps:g} a second") in clip_summary("tube", clip).facts


def write_walk(folder: Path) -> Path:
    for name, rest, mesh in (("garment", "template", VEST), ("body", "body_rest", BODY)):
        write_obj(folder / f"{rest}.obj", mesh.vertices, mesh.faces)
        write_mdd(folder / f"{name}.mdd", np.repeat(mesh.vertices[None], 7, axis=0), 24.0)
    return folder


def test_import_says_what_it_takes_and_a_dry_run_stops_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = write_walk(tmp_path / "walk"), tmp_path / "set"
    argv = ["import", "meshes", str(folder), "--to", str(out), "--split", "train"]
    assert main([*argv, "--dry-run"]) == 0
    said = capsys.readouterr().out
    for text in (
        "garment/walk\n",
        f"garment.mdd: 7 frames, at rest as in {folder / 'template.obj'}",
        "body.mdd: 7 frames",
        "units    metres, assumed",
        "as the body's shape tells",
        "rate     24 a second, from the file",
    ):
        assert text in said
    assert said.endswith(f"dry run  1 clips would be imported into {out}; nothing was written\n")
    assert not out.exists()
    assert main([*argv, "--fps", "25"]) == 0
    again = capsys.readouterr().out
    assert "rate     25 a second, given" in again
    assert "done     1 clips" in again


def test_a_dry_run_of_clips_reads_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_clip(tmp_path / "tube_a.npz", tube_clip(5))
    save_clip(tmp_path / "tube_b.npz", tube_clip(6))
    argv = ["import", str(tmp_path), "--to", str(tmp_path / "set"), "--split", "train", "--dry-run"]
    assert main(argv) == 0
    said = capsys.readouterr().out
    assert "tube/a  train" in said
    assert "tube/b  train" in said
    assert "frames   5 at " in said
    assert "dry run  2 clips" in said
    assert not (tmp_path / "set").exists()


def test_simulate_says_its_plan_and_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_walk(tmp_path / "walk")
    out = tmp_path / "set"
    argv = [
        "simulate",
        str(folder),
        "--template",
        str(folder / "template.obj"),
        "--out",
        str(out),
        "--dry-run",
    ]
    assert main(argv) == 0
    said = capsys.readouterr().out
    assert "body.mdd: 7 frames" in said
    assert "24 a second, from the file" in said
    # 7 frames at 24 a second are 0.25 s, 8 frames at the simulation's 30.
    assert "template/walk (train): 8 frames, 0.23 s, on its own body\n" in said
    assert said.endswith(f"dry run  1 of 1 clips would be simulated into {out}; nothing was written\n")
    assert not out.exists()


def test_simulate_plans_clips_of_the_library(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "c.yaml"
    config.write_text('{"clips": [{"motion": "walk", "seconds": 1.0}, {"motion": "squat", "seconds": 0.5}]}')
    assert main(["simulate", str(config), "--out", str(tmp_path / "set"), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "tshirt/walk_s0 (train): " in said
    assert "2 of 2 clips would be simulated" in said
    assert not (tmp_path / "set").exists()
