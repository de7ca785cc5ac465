"""Axes and units are told from the motion as well as from the rest mesh, for every command that reads one."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.importers.checks.axes import AXES, UNITS, Axes, InMetres, MotionAxes, usual_facing
from imgtransfer.importers.checks.motion import check_motion, motion_facts, note_motion
from render import InputError, Mesh, MeshSequence
from tests.helpers.import_examples import standing_body, vest, write_mdd, write_obj, write_pc2

BODY = standing_body()
VEST = vest(BODY)
METRES = Axes()


def walked(mesh: Mesh, frames: int = 4) -> np.ndarray:
    """(T, N, 3) a walk ahead with a turn about the vertical."""
    angle = 0.3 * np.arange(frames)
    turn = np.zeros((frames, 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 2], turn[:, 2, 0], turn[:, 1, 1] = np.sin(angle), -np.sin(angle), 1
    moved = np.einsum("tab,nb->tna", turn, mesh.vertices)
    moved[..., 2] += 0.1 * np.arange(frames)[:, None]
    return moved


def sequence(moved: np.ndarray, mesh: Mesh = BODY) -> MeshSequence:
    return MeshSequence.of_array(mesh, moved, source="walk.pc2")


def taken(moved: np.ndarray, mesh: Mesh = BODY, lay: Axes = METRES) -> InMetres:
    return InMetres(sequence(moved, mesh), lay, lay)


def in_file(points: np.ndarray, axes: Axes) -> np.ndarray:
    return points @ axes.rotation / axes.scale


def test_an_upright_body_of_the_same_size_has_no_fault() -> None:
    facts = motion_facts(sequence(walked(BODY)))
    assert facts is not None
    assert facts.size == pytest.approx(1)
    assert facts.up is None
    assert check_motion([taken(walked(BODY))]) == []


@pytest.mark.parametrize("up", [axis for axis in AXES if axis != "y"])
@pytest.mark.parametrize("lay", [METRES, Axes("z", "-y")], ids=["y up", "z up"])
def test_frames_with_another_axis_up_name_it_as_their_file_does(up: str, lay: Axes) -> None:
    # As the file has them with `up` up, and as they are taken with the axes that the user gave.
    if up == lay.up:
        up = "y"
    theirs = in_file(walked(BODY), Axes(up, usual_facing(up) if up[-1] != "z" else "x"))
    (fault,) = check_motion([taken(lay.apply(theirs), lay=lay)])
    assert (fault.kind, fault.severe) == ("axes", True)
    assert fault.text.endswith(f"its frames all lie, with {up} up: add motion_up={up!r}")


@pytest.mark.parametrize("unit", ["cm", "mm", "in", "ft"])
def test_frames_in_other_units_than_the_rest_mesh(unit: str) -> None:
    (fault,) = check_motion([taken(walked(BODY) / UNITS[unit])])
    assert fault.text.endswith(f"in other units: add motion_unit={unit!r}")
    (fault,) = check_motion([taken(walked(BODY) * 3)])
    assert "its frames are 3 times as large as body.obj" in fault.text
    assert fault.text.endswith("export both in the same units")


def test_both_at_once() -> None:
    faults = check_motion([taken(in_file(walked(BODY), Axes("z", "-y", 0.01)))])
    assert [fault.text.rpartition(": ")[2] for fault in faults] == [
        "add motion_unit='cm'",
        "add motion_up='z'",
    ]


def test_somebody_who_lies_down_or_gets_up_is_no_fault() -> None:
    lying = in_file(walked(BODY), Axes("z", "-y"))
    assert check_motion([taken(np.concatenate([lying, walked(BODY)]))]) == []
    turning = np.concatenate([lying, in_file(walked(BODY), Axes("x", "z"))])
    assert check_motion([taken(turning)]) == []


def test_a_garment_alone_that_lies_gets_no_flag_that_would_turn_the_body_too() -> None:
    lying = in_file(walked(VEST), Axes("z", "-y"))
    (fault,) = check_motion([taken(walked(BODY)), taken(lying, VEST)])
    assert fault.text.endswith("export both with the same axis up")
    (both,) = check_motion([taken(in_file(walked(BODY), Axes("z", "-y"))), taken(lying, VEST)])
    assert "upright in body.obj" in both.text
    assert "upright in vest.obj" in both.text
    assert both.text.count("add motion_up='z'") == 1


def test_shapes_that_tell_nothing_and_vertices_that_no_face_uses() -> None:
    line = Mesh(np.array([[0.0, 0, 0], [0, 1, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    assert motion_facts(sequence(np.zeros((2, 3, 3)), line)) is None
    point = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    assert motion_facts(sequence(np.zeros((2, 3, 3)), point)) is None
    far = Mesh(np.concatenate([BODY.vertices, [[50.0, 0, 0]]]), BODY.faces)
    moved = np.concatenate([walked(BODY), np.tile([0.0, 0, 900.0], (4, 1, 1))], axis=1)
    assert check_motion([taken(moved, far)]) == []


def test_programs_that_go_on_note_what_lies_and_refuse_other_units(caplog: pytest.LogCaptureFixture) -> None:
    note_motion([taken(in_file(walked(BODY), Axes("z", "-y")))])
    assert "note: walk.pc2: upright in body.obj, but its frames all lie, with z up" in caplog.text
    with pytest.raises(InputError, match=r"other units: add motion_unit='cm'$"):
        note_motion([taken(walked(BODY) * 100)])


def test_how_frames_lie_beside_their_rest_mesh() -> None:
    rest = Axes("z", "x", 0.01)
    assert MotionAxes().beside(rest) == rest
    assert MotionAxes(up="y").beside(rest) == Axes("y", "z", 0.01)
    assert MotionAxes(up="z", scale=1.0).beside(rest) == Axes("z", "x", 1.0)
    assert MotionAxes(up="z").beside(Axes()) == Axes("z", "-y")
    with pytest.raises(InputError, match="must be different axes"):
        MotionAxes(facing="-z").beside(rest)


# The commands: rest meshes y up in metres, caches as a modelling program exports them, z up in centimetres or metres.


def write_clip(folder: Path, axes: Axes, *, mdd: bool = False) -> Path:
    for name, rest, mesh in (("garment", "template", VEST), ("body", "body_rest", BODY)):
        write_obj(folder / f"{rest}.obj", mesh.vertices, mesh.faces)
        moved = in_file(walked(mesh), axes)
        if mdd:
            write_mdd(folder / f"{name}.mdd", moved, 30.0)
        else:
            write_pc2(folder / f"{name}.pc2", moved)
    return folder


def arguments(command: str, folder: Path, suffix: str) -> list[str]:
    template, body = folder / "template.obj", folder / f"body.{suffix}"
    words: dict[str, list[object]] = {
        "import": ["import", "meshes", folder, "--to", folder / "set", "--split", "train"],
        "render": [
            "render", folder / f"garment.{suffix}", "--template", template, "--body", body,
            "--body-template", folder / "body_rest.obj", "--out", folder / "maps", "--size", "16", "--frames", "0",
        ],
        "simulate": ["simulate", folder, "--template", template, "--out", folder / "set", "--dry-run"],
    }  # fmt: skip
    return [str(word) for word in words[command]]


@pytest.mark.parametrize("suffix", ["pc2", "mdd"])
@pytest.mark.parametrize("command", ["import", "simulate"])
def test_caches_z_up_are_refused_with_the_flags_that_mend_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, suffix: str
) -> None:
    write_clip(tmp_path / "walk", Axes("z", "-y", 0.01), mdd=suffix == "mdd")
    argv = arguments(command, tmp_path / "walk", suffix)
    assert main(argv) == 2
    said = capsys.readouterr().err
    flags = re.findall(r"add (--motion-[^\s;]+)", said)
    assert set(flags) == {"--motion-unit=cm", "--motion-up=z"}
    assert main([*argv, *sorted(set(flags))]) == 0
    assert "lie" not in capsys.readouterr().err


def test_render_refuses_other_units_and_notes_other_axes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_clip(tmp_path / "walk", Axes("z", "-y", 0.01))
    argv = arguments("render", tmp_path / "walk", "pc2")
    assert main(argv) == 2
    assert "add --motion-unit=cm" in capsys.readouterr().err
    assert main([*argv, "--motion-unit=cm"]) == 0
    assert "note: " in (said := capsys.readouterr().err)
    assert "add --motion-up=z" in said
    assert main([*argv, "--motion-unit=cm", "--motion-up=z"]) == 0
    assert "note: " not in capsys.readouterr().err


def test_fuse_reads_a_cache_as_the_mesh_beside_it_lies(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from imgtransfer.cli.fuse_files import given_files  # noqa: PLC0415
    from imgtransfer.cli.main import build_parser  # noqa: PLC0415

    folder = write_clip(tmp_path / "walk", Axes("z", "-y"))

    def given(*flags: str) -> np.ndarray:
        words = ["fuse", "--maps", "m.npz", "--out", "o", "--body", str(folder / "body.pc2"), *flags]
        body = given_files(build_parser().parse_args(words)).body
        assert body is not None
        return body.vertices()

    given()
    assert "add motion_up='z'" in caplog.text
    caplog.clear()
    np.testing.assert_allclose(given("--motion-up=z"), walked(BODY), atol=1e-5)
    assert caplog.text == ""
    with pytest.raises(InputError, match="add motion_unit='m'"):
        given("--unit=m", "--motion-unit=mm", "--motion-up=z")


def test_a_rest_mesh_that_lies_is_named_before_its_frames(caplog: pytest.LogCaptureFixture) -> None:
    rest = Mesh(in_file(BODY.vertices, Axes("z", "-y")), BODY.faces, "rest.obj")
    aside = in_file(walked(BODY), Axes("z", "x"))
    note_motion([taken(aside, rest)])
    assert "rest.obj: stands along z and faces -y: add up='z' facing='-y'" in caplog.text
    assert "walk.pc2" not in caplog.text


def test_vertices_in_another_order_tell_nothing() -> None:
    shuffled = walked(BODY)[:, np.random.default_rng(0).permutation(len(BODY.vertices))]
    assert motion_facts(sequence(shuffled)) is None
