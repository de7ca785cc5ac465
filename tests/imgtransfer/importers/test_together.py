"""A garment and a body of two files at the same frames: by time where the files have times, one body held still."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.store import DataSet
from imgtransfer.importers.together import together
from imgtransfer.pipeline.scene import mesh_scene
from render import InputError, Mesh, MeshSequence
from tests.helpers.import_examples import standing_body, vest, write_obj, write_pc2
from tests.helpers.scenes import Written, write_abc, write_usd

BODY = standing_body()
VEST = vest(BODY)
SQUARE = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
SPEED = np.array([0, 0, 0.2])  # metres a second


def at_times(mesh: Mesh, seconds: np.ndarray) -> np.ndarray:
    return mesh.vertices + seconds[:, None, None] * SPEED


def timed(name: str, start: float, fps: float, count: int) -> MeshSequence:
    seconds = start + np.arange(count) / fps
    sequence = MeshSequence.of_array(SQUARE, at_times(SQUARE, seconds), source=name, fps=fps)
    return replace(sequence, start=start)


@pytest.mark.parametrize(
    ("garment", "body", "wanted"),
    [
        ((0.0, 25.0, 11), (0.0, 50.0, 21), np.arange(11) / 25),  # twice as many samples
        ((0.0, 25.0, 11), (0.0, 10.0, 5), np.arange(11) / 25),  # between samples
        ((0.0, 25.0, 11), (0.1, 25.0, 11), 0.12 + np.arange(8) / 25),  # a later start, between frames
        ((1.0, 24.0, 25), (0.0, 24.0, 31), 1 + np.arange(7) / 24),  # an earlier one, and an earlier end
    ],
)
def test_frames_are_matched_by_time(
    garment: tuple[float, float, int], body: tuple[float, float, int], wanted: np.ndarray
) -> None:
    cloth, skin, note = together(timed("a.abc", *garment), timed("b.abc", *body))
    for moving in (cloth, skin):
        np.testing.assert_allclose(moving.vertices(), at_times(SQUARE, wanted), atol=1e-12)
        np.testing.assert_array_equal(moving.frames([1, 3]), moving.vertices()[[1, 3]])
        assert moving.fps == garment[1]
        assert moving.start == pytest.approx(wanted[0])
    assert f"matched by time, {len(wanted)} frames from {wanted[0]:g} s on" in note
    assert f"b.abc: {body[0]:g} to " in note


def test_what_has_the_same_times_or_none_is_left_as_it_is() -> None:
    one, other = timed("a", 1, 25, 4), timed("b", 1.0001, 25, 4)
    assert together(one, other) == (one, other, "")
    plain = replace(timed("b", 0, 30, 4), start=None)
    assert together(one, plain) == (one, plain, "")
    with pytest.raises(InputError, match="a: 4 frames, but b has 5 frames; both must have the same frames"):
        together(one, replace(timed("b", 0, 30, 5), start=None))


def test_times_without_two_frames_in_common_are_refused() -> None:
    with pytest.raises(InputError, match=r"a: 0 to 0\.4 s, 25 frames a second, but b: 0\.4 to 0\.8 s"):
        together(timed("a", 0, 25, 11), timed("b", 0.4, 25, 11))


def test_one_frame_of_a_body_is_held_and_one_of_a_garment_is_not() -> None:
    cloth, skin, note = together(timed("a", 0, 25, 5), timed("b", 0, 1, 1))
    np.testing.assert_array_equal(skin.vertices(), [SQUARE.vertices] * 5)
    np.testing.assert_array_equal(skin.frame(3), SQUARE.vertices)
    assert note == "b: one frame, held still for the 5 of a"
    assert cloth.n_frames == 5
    with pytest.raises(InputError, match="both must have the same frames"):
        together(timed("a", 0, 25, 1), timed("b", 0, 25, 5))


@pytest.mark.parametrize("name", ["body.obj", "body/frame_1.obj"])
def test_a_still_body_in_a_clip_s_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    moved = np.float32(at_times(VEST, np.arange(3) / 30))
    write_pc2(tmp_path / "walk/garment.pc2", moved)
    write_obj(tmp_path / "walk/template.obj", VEST.vertices, VEST.faces)
    write_obj(tmp_path / "walk" / name, BODY.vertices, BODY.faces)
    argv = ["import", "meshes", str(tmp_path / "walk"), "--to", str(tmp_path / "set"), "--split", "train"]
    assert main(argv) == 0
    assert "one frame, held still for the 3 of" in capsys.readouterr().err
    clip = DataSet.open(tmp_path / "set").read("garment/walk")
    np.testing.assert_allclose(clip.body.vertices, [BODY.vertices] * 3, atol=1e-6)


def test_files_of_other_sample_times_are_rendered_by_time(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for name, mesh, fps, count in (("vest", VEST, 25, 5), ("body", BODY, 50, 9)):
        seconds = np.arange(count) / fps
        frames = Written(
            at_times(mesh, seconds), seconds.tolist(), [3] * len(mesh.faces), mesh.faces.ravel().tolist()
        )
        write_abc(tmp_path / f"{name}.abc", {f"/{name}": frames})
    scene = mesh_scene(
        *(tmp_path / "vest.abc",) * 2, body_template=tmp_path / "body.abc", body=tmp_path / "body.abc"
    )
    np.testing.assert_allclose(
        scene.meshes["body"].vertices(), at_times(BODY, np.arange(5) / 25), rtol=0, atol=1e-6
    )
    assert "matched by time, 5 frames from 0 s on" in caplog.text


def test_a_folder_of_one_scene_file_a_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    moved = at_times(VEST, np.arange(3) / 30)
    for number, frame in enumerate(moved):
        counts = [3] * len(VEST.faces)
        corners, time = VEST.faces.ravel().tolist(), [number / 24]
        written = {
            "/a/Vest": Written(frame[None] * 100, time, counts, corners),
            "/a/Other": Written(frame[None], time, counts, corners),
        }
        folder = tmp_path / "walk/garment"
        folder.mkdir(parents=True, exist_ok=True)
        write_usd(folder / f"frame_{number + 9}.usda", written, metres=0.01)
    write_obj(tmp_path / "walk/body.obj", BODY.vertices, BODY.faces)
    argv = ["import", "meshes", str(tmp_path / "walk"), "--to", str(tmp_path / "set"), "--split", "train"]
    assert main(argv) == 2
    assert "2 meshes (/a/Vest, /a/Other); choose one with --garment-object" in capsys.readouterr().err
    assert main([*argv, "--garment-object", "Vest"]) == 0
    assert "3 frames (frame_9.usda to frame_11.usda)" in capsys.readouterr().out
    clip = DataSet.open(tmp_path / "set").read("garment/walk")
    assert clip.garment is not None
    np.testing.assert_allclose(clip.garment.vertices, moved, rtol=0, atol=1e-6)
