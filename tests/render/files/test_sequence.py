"""Meshes in motion from files: their order, their gaps, what changes on the way, and parts that make up the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from render import InputError, Mesh
from render.files.frame_files import frame_files
from render.files.sequence import is_sequence, open_arrays, open_sequence, sequence_files
from tests.helpers import synthetic
from tests.helpers.import_examples import write_mdd, write_obj, write_pc2

TUBE, FACES = synthetic.tube(0.2, 0.5, 4, 6, closed=False)


def write_frames(folder: Path, numbers: list[int], name: str = "shirt_{}") -> Path:
    for number in numbers:
        write_obj(folder / f"{name.format(number)}.obj", TUBE + [number, 0, 0], FACES)  # noqa: RUF005
    return folder


def test_frame_10_comes_after_frame_2(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", list(range(12)))
    moving = open_sequence(folder)
    assert moving.vertices().shape == (12, len(TUBE), 3)
    np.testing.assert_allclose(moving.vertices()[:, 0, 0], TUBE[0, 0] + np.arange(12), atol=1e-5)
    assert [file.stem for file in frame_files(folder)[:3]] == ["shirt_0", "shirt_1", "shirt_2"]


def test_every_second_frame_is_no_gap(tmp_path: Path) -> None:
    assert len(frame_files(write_frames(tmp_path / "frames", [2, 4, 6]))) == 3


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([0, 1, 3, 4], r"shirt_0\.obj and shirt_4\.obj: 2 \(4 files"),
        ([0, 2, 3], "missing"),
        ([1, 2, 9], r"3, 4, 5, 6, 7 \.\.\."),
        ([20260101000000, 20260101000001, 20260201000000], "20260101000002, 20260101000003,.* ... .3 files"),
        ([1, 2, 10**30], "3, 4, 5, 6, 7 ... .3 files"),
        ([1, 3, 6], "uneven steps|5"),
    ],
)
def test_missing_frames_are_named(tmp_path: Path, numbers: list[int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_sequence(write_frames(tmp_path / "frames", numbers))


def test_the_same_frame_twice(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [0, 1])
    write_obj(folder / "shirt_01.obj", TUBE, FACES)
    with pytest.raises(InputError, match="are the same frame"):
        open_sequence(folder)


def test_frames_of_two_meshes_in_one_folder_ask_for_a_pattern(tmp_path: Path) -> None:
    write_frames(tmp_path / "frames", [0, 1], "body_{}")
    write_frames(tmp_path / "frames", [0, 1], "shirt_{}")
    with pytest.raises(InputError, match=r"several kinds \(body_#\.obj, shirt_#\.obj\).*body_\*\.obj"):
        frame_files(tmp_path / "frames")
    assert len(frame_files(tmp_path / "frames/shirt_*.obj")) == 2


def test_a_vertex_count_that_changes_is_named(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [0, 1, 2])
    more, faces = synthetic.tube(0.2, 0.5, 5, 6, closed=False)
    write_obj(folder / "shirt_1.obj", more, faces)
    with pytest.raises(
        InputError, match=r"shirt_1\.obj: 30 vertices, but the first frame has 24; the vertex count must not"
    ):
        open_sequence(folder).vertices()


def test_other_triangles_are_named(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [0, 1, 2])
    write_obj(folder / "shirt_2.obj", TUBE, FACES[::-1])
    with pytest.raises(
        InputError, match=r"shirt_2\.obj: as many vertices as the first frame, but other triangles"
    ):
        open_sequence(folder).vertices()


def test_a_frame_that_is_not_finite_is_named(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [0, 1])
    broken = TUBE.copy()
    broken[3] = np.nan
    write_obj(folder / "shirt_1.obj", broken, FACES)
    with pytest.raises(InputError, match=r"shirt_1\.obj: vertex 3 is .*not finite"):
        open_sequence(folder).vertices()


def test_frames_that_are_not_there(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for place, message in (
        ("empty", "no OBJ, PLY or GLB files"),
        ("none", "no such folder"),
        ("none_*.obj", "no OBJ"),
    ):
        with pytest.raises(InputError, match=message):
            frame_files(tmp_path / place)
    write_obj(tmp_path / "names/one.obj", TUBE, FACES)
    write_obj(tmp_path / "names/one .obj", TUBE, FACES)
    with pytest.raises(InputError, match="several kinds"):
        frame_files(tmp_path / "names")


def test_a_cache_needs_its_own_mesh(tmp_path: Path) -> None:
    path = write_pc2(tmp_path / "a.pc2", np.repeat(TUBE[None], 3, axis=0))
    np.testing.assert_array_equal(open_sequence(path, Mesh(TUBE, FACES)).vertices()[2], TUBE)
    with pytest.raises(InputError, match="a point cache has no triangles"):
        open_sequence(path)
    other = Mesh(*synthetic.tube(0.2, 0.5, 5, 6, closed=False), source="other.obj")
    with pytest.raises(InputError, match=r"24 points a frame, but other\.obj has 30 vertices"):
        open_sequence(path, other)


def test_the_order_is_that_of_the_numbers_by_value(tmp_path: Path) -> None:
    for names, wanted in (
        (["b_2", "b_10", "b_1", *(f"b_{n}" for n in range(3, 10))], [f"b_{n}" for n in range(1, 11)]),
        (["b_08", "b_10", "b_9"], ["b_08", "b_9", "b_10"]),
        (["b_002.cut", "b_010.cut", "b_018.cut"], ["b_002.cut", "b_010.cut", "b_018.cut"]),
        (["take2_f3", "take2_f1", "take2_f2"], ["take2_f1", "take2_f2", "take2_f3"]),
    ):
        folder = tmp_path / names[0]
        for name in names:
            write_obj(folder / f"{name}.obj", TUBE, FACES)
        assert [file.stem for file in frame_files(folder)] == wanted


def test_a_gap_after_frame_9_is_named_by_its_first_number(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [8, 9, 11, 12], "body_{}")
    with pytest.raises(
        InputError, match=r"missing between body_8\.obj and body_12\.obj: 10 \(4 files found\)"
    ):
        open_sequence(folder)


def test_endings_in_capitals_are_the_same_endings(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [1, 3])
    write_obj(folder / "shirt_2.OBJ", TUBE + 7, FACES)
    assert [file.name for file in frame_files(folder)] == ["shirt_1.obj", "shirt_2.OBJ", "shirt_3.obj"]
    np.testing.assert_array_equal(open_sequence(folder).vertices()[1], np.float32(TUBE + 7))
    write_obj(folder / "shirt_1.OBJ", TUBE, FACES)
    with pytest.raises(InputError, match=r"shirt_1\.(obj|OBJ) and shirt_1\.(obj|OBJ) are the same frame"):
        open_sequence(folder)


def test_files_of_two_formats_are_no_sequence(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "frames", [0, 1])
    (folder / "shirt_2.ply").write_text("ply")
    with pytest.raises(InputError, match=r"several kinds \(shirt_#\.obj, shirt_#\.ply\)"):
        open_sequence(folder)
    (folder / "shirt_2.ply").unlink()
    for other in ("notes_7.txt", ".shirt_9.obj", "template.stl"):
        (folder / other).write_text("not a frame")
    assert len(frame_files(folder)) == 2


def test_frames_without_numbers_have_no_order(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    for name in ("a", "b"):
        write_obj(folder / f"{name}.obj", TUBE, FACES)
    with pytest.raises(InputError, match="several kinds"):
        open_sequence(folder)
    (folder / "b.obj").unlink()
    assert open_sequence(folder).n_frames == 1


def test_brackets_in_names_that_are_there_are_no_pattern(tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "shot [12]", [1, 2], "body[x]_{}")
    assert [file.name for file in frame_files(folder)] == ["body[x]_1.obj", "body[x]_2.obj"]
    assert frame_files(folder / "body[x]_2.obj") == [folder / "body[x]_2.obj"]
    assert len(frame_files(folder / "body?x?_*.obj")) == 2
    cache = write_pc2(tmp_path / "body[1].pc2", TUBE[None])
    assert open_sequence(cache, Mesh(TUBE, FACES)).n_frames == 1
    with pytest.raises(InputError, match="no OBJ, PLY or GLB files here"):
        frame_files(folder / "body[x]_3.obj")


def test_one_file_is_one_frame(tmp_path: Path) -> None:
    path = write_obj(tmp_path / "shirt.obj", TUBE, FACES)
    moving = open_sequence(path)
    assert (moving.n_frames, moving.frame_name(0), moving.fps) == (1, "shirt.obj", None)
    np.testing.assert_array_equal(moving.vertices(), np.float32(TUBE)[None])
    with pytest.raises(InputError, match=r"none\.obj: no such file; a mesh file is wanted"):
        open_sequence(tmp_path / "none.obj")
    with pytest.raises(InputError, match=r"notes\.txt: no such folder; wanted is a folder of OBJ"):
        open_sequence(tmp_path / "notes.txt")


def test_frames_of_stl_alone_are_read_where_their_vertices_keep_their_order(tmp_path: Path) -> None:
    import trimesh  # noqa: PLC0415

    (tmp_path / "frames").mkdir()
    for number in (1, 2):
        trimesh.Trimesh(TUBE + number, FACES, process=False).export(tmp_path / f"frames/t_{number}.stl")
    found = open_sequence(tmp_path / "frames").vertices()
    np.testing.assert_allclose(found[1], found[0] + 1, atol=1e-6)


@pytest.mark.parametrize("kind", ["folder", "pattern", "pc2", "pc16", "mdd", "npz"])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 100])
def test_parts_make_up_the_whole(tmp_path: Path, kind: str, count: int) -> None:
    places = np.float32(TUBE[None] + np.arange(7)[:, None, None])
    folder = write_frames(tmp_path / "frames", list(range(7)))
    if kind == "folder":
        moving = open_sequence(folder)
    elif kind == "pattern":
        moving = open_sequence(folder / "shirt_?.obj")
    elif kind == "npz":
        np.savez(tmp_path / "m.npz", f=FACES, v=places)
        moving = open_arrays(tmp_path / "m.npz", "f", "v")
    elif kind == "mdd":
        moving = open_sequence(write_mdd(tmp_path / "a.mdd", places, 24.0), Mesh(TUBE, FACES))
        assert moving.fps == pytest.approx(24, abs=0.01)
    else:
        path = write_pc2(tmp_path / f"a.{kind}", places, half=kind == "pc16")
        moving = open_sequence(path, Mesh(TUBE, FACES))
    parts = list(moving.parts(count))
    assert [len(part) for part in parts] == [min(count, 7 - first) for first in range(0, 7, count)]
    np.testing.assert_array_equal(np.concatenate(parts), moving.vertices())
    np.testing.assert_array_equal(np.concatenate(list(moving.parts(count))), moving.vertices())  # once more
    steps: list[int] = []
    np.testing.assert_array_equal(moving.vertices(steps.append), moving.vertices())
    assert sum(steps) == moving.n_frames == 7


def test_memory_does_not_grow_with_the_length(tmp_path: Path) -> None:
    import tracemalloc  # noqa: PLC0415

    points = np.random.default_rng(0).normal(size=(400, 500, 3)).astype(np.float32)  # 2.4 MB
    mesh = Mesh(points[0], np.array([[0, 1, 2]]))
    np.savez(tmp_path / "m.npz", f=mesh.faces, v=points)
    for moving in (
        open_sequence(write_pc2(tmp_path / "a.pc2", points), mesh),
        open_arrays(tmp_path / "m.npz", "f", "v"),
    ):
        tracemalloc.start()
        for part in moving.parts(4):
            assert len(part) == 4
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < points.nbytes / 2


def test_what_is_a_sequence(tmp_path: Path) -> None:
    assert is_sequence(tmp_path)
    assert is_sequence(tmp_path / "a_*.obj")
    for name in ("a.obj", "a.PLY", "a.pc2", "a.mdd", "a.stl"):
        assert is_sequence(tmp_path / name)
    for name in ("a.npz", "a", "a.txt"):
        assert not is_sequence(tmp_path / name)
    folder = write_frames(tmp_path / "frames", [1, 2])
    assert sequence_files(folder) == frame_files(folder)
    assert sequence_files(tmp_path / "a.pc2") == [tmp_path / "a.pc2"]


def test_a_cache_that_is_cut_off_while_it_is_read(tmp_path: Path) -> None:
    path = write_pc2(tmp_path / "a.pc2", np.repeat(np.float32(TUBE)[None], 3, axis=0))
    moving = open_sequence(path, Mesh(TUBE, FACES))
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(InputError, match=r"a\.pc2: truncated while it was read"):
        list(moving.parts(1))


def test_a_frame_of_zeros_is_named_by_its_number(tmp_path: Path) -> None:
    places = np.repeat(np.float32(TUBE)[None], 5, axis=0)
    places[3] = 0
    moving = open_sequence(write_pc2(tmp_path / "a.pc2", places), Mesh(TUBE, FACES))
    with pytest.raises(InputError, match="all points of frame 3 are 0"):
        list(moving.parts(2))


def test_arrays_that_do_not_fit_are_named(tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    broken = np.repeat(TUBE[None], 3, axis=0)
    broken[2, 1] = np.nan
    for arrays, message in (
        ({"f": FACES}, r"lacks v; a mesh in motion needs both"),
        ({"f": FACES, "v": TUBE}, r"v must have shape \(frames, vertices, 3\), found \(24, 3\)"),
        ({"f": FACES, "v": TUBE[None, :5]}, r"f: face \d+ uses vertices"),
        ({"f": FACES, "v": np.full((1, 24, 3), np.inf)}, "v: frame 0, vertex 0 is .*not finite"),
        ({"f": FACES, "v": broken}, "v: frame 2, vertex 1 is .*not finite"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message):
            open_arrays(path, "f", "v").vertices()
    with pytest.raises(InputError, match="no such file; an npz with f and v"):
        open_arrays(tmp_path / "none.npz", "f", "v")


def test_arrays_keep_their_precision(tmp_path: Path) -> None:
    for given, kept in (
        (np.float64, np.float64),
        (">f8", np.float64),
        (np.float16, np.float32),
        (np.int16, np.float32),
    ):
        np.savez(tmp_path / "m.npz", f=FACES, v=np.ones((2, 24, 3), given))
        assert open_arrays(tmp_path / "m.npz", "f", "v").vertices().dtype == kept
