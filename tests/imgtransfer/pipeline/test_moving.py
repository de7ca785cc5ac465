"""Surfaces in motion and pins from the files that people have."""

import numpy as np
import pytest

from imgtransfer.pipeline.moving import Pins, load_pins, open_moving
from render import InputError

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def obj(vertices, faces=FACES):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    return "\n".join(lines) + "\n"


def all_frames(moving):
    parts = list(moving.parts(1))
    assert len(parts) == moving.n_frames
    return np.concatenate([part.vertices for part in parts])


@pytest.mark.parametrize("kind", ["body", "garment"])
def test_npz_mesh_and_folder_say_the_same(tmp_path, kind):
    moved = np.stack([SQUARE, SQUARE + 1])
    np.savez(tmp_path / "m.npz", **{f"{kind}_faces": FACES, f"{kind}_vertices": moved})
    (tmp_path / "frames").mkdir()
    for name, vertices in zip(("b", "a"), moved[::-1], strict=True):
        (tmp_path / "frames" / f"{name}.obj").write_text(obj(vertices))
    (tmp_path / "frames" / "notes.txt").write_text("no mesh")
    for path in (tmp_path / "m.npz", tmp_path / "frames"):
        found = open_moving(path, kind)
        np.testing.assert_array_equal(all_frames(found), moved)
        np.testing.assert_array_equal(found.faces, FACES)
    single = open_moving(tmp_path / "frames" / "a.obj", kind)
    np.testing.assert_array_equal(all_frames(single), moved[:1])


def test_frames_of_a_folder_must_be_of_one_mesh(tmp_path):
    (tmp_path / "a.obj").write_text(obj(SQUARE))
    (tmp_path / "b.obj").write_text(obj(SQUARE, FACES[:, ::-1]))
    with pytest.raises(
        InputError, match=r"b\.obj: 4 vertices and 2 faces; every frame must have those of .*a\.obj"
    ):
        all_frames(open_moving(tmp_path, "body"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no mesh file in it"):
        open_moving(tmp_path / "empty", "body")


def test_arrays_that_do_not_fit_are_named(tmp_path):
    path = tmp_path / "m.npz"
    with pytest.raises(
        InputError, match="no such file; an npz with body_faces and body_vertices, or mesh files"
    ):
        open_moving(path, "body")
    np.savez(path, body_faces=FACES, body_vertices=SQUARE)
    with pytest.raises(
        InputError, match=r"body_vertices must have shape \(frames, vertices, 3\), found \(4, 3\)"
    ):
        open_moving(path, "body")
    with pytest.raises(
        InputError, match="lacks garment_faces and garment_vertices; a garment in motion needs both"
    ):
        open_moving(path, "garment")


def test_pins_from_text(tmp_path):
    path = tmp_path / "pins.txt"
    path.write_text("3, 1\n# all of them: 9\n7;8  # the collar\n")
    assert load_pins(path).indices.tolist() == [3, 1, 7, 8]
    assert load_pins(path).over(5) is None
    for text, message in (
        ("3 x", "line 1: vertex numbers from 0 are wanted, found 'x'"),
        ("# 1", "no vertex numbers"),
        ("", "no vertex numbers"),
        ("-1", "found '-1'"),
        ("²", "found '²'"),
        ("٣", "found '٣'"),
        ("1_0", "found '1_0'"),
        ("1e3", "found '1e3'"),
        ("9" * 5000, "found '9999"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            load_pins(path)


def test_pins_with_places(tmp_path):
    path = tmp_path / "pins.npz"
    np.savez(path, indices=np.array([3, 1]), positions=SQUARE[:2])
    assert load_pins(path).over(3).shape == (3, 2, 3)
    np.savez(path, indices=np.array([3, 1]), positions=np.stack([SQUARE[:2]] * 2))
    np.testing.assert_array_equal(load_pins(path).over(2)[1], SQUARE[:2])
    with pytest.raises(InputError, match="positions of 2 frames, but the maps have 3"):
        load_pins(path).over(3)
    for arrays, message in (
        ({"positions": SQUARE}, "lacks indices"),
        ({"indices": np.array([0.5])}, "indices must be whole numbers"),
        ({"indices": np.array([1]), "positions": SQUARE}, r"positions must have shape \(1, 3\)"),
        ({"indices": np.array([1]), "positions": np.full((1, 3), np.nan)}, "not finite"),
        ({"indices": np.array([1]), "positions": np.full((1, 3), 1e30)}, "beyond ±10000 m"),
        ({"indices": np.array([1]), "positions": np.float64(1)}, r"positions must have shape \(1, 3\)"),
        ({"indices": np.array([1]), "positions": np.array([["a", "b", "c"]])}, "numbers are wanted"),
        ({"indices": np.array([3, -1])}, "vertex numbers from 0, found -1"),
        ({"indices": np.array([2**63], np.uint64)}, "vertex numbers from 0, found 9223372036854775808"),
        ({"indices": np.int64(1)}, "indices must be whole numbers"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message):
            load_pins(path)


def test_pins_beyond_the_garment_are_named_with_their_file(tmp_path):
    (tmp_path / "pins.txt").write_text("1 7")
    pins = load_pins(tmp_path / "pins.txt")
    pins.check(8)
    with pytest.raises(InputError, match=r"pins\.txt: vertex 7 is wanted, but the garment has 0\.\.6"):
        pins.check(7)


def test_pins_without_places_stay():
    assert Pins(np.array([1])).over(2) is None
