"""A data set that lost or damaged something says so, and writers that die leave nothing that counts."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from zarr.storage import LocalStore

from imgtransfer.cli.main import main
from imgtransfer.data import grid
from imgtransfer.data.arrays import StoredArray
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.local_place import LocalPlace
from imgtransfer.data.metadata import read_arrays
from imgtransfer.data.reader import LoadedReader, NpzReader
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from render import InputError
from tests.helpers import synthetic
from tests.helpers.clips import assert_same_clip, on_grid
from tests.helpers.old_data import as_version_1
from tests.helpers.paths import ROOT

FRAMES = 70  # three chunks


@pytest.fixture(scope="module")
def long_clip() -> Clip:
    return on_grid(synthetic.tube_clip(FRAMES))


@pytest.fixture
def data(tmp_path: Path, long_clip: Clip) -> DataSet:
    data = DataSet.create(tmp_path / "set")
    data.write("tube/bend", long_clip, split="train")
    return data


CHUNKS = {
    "garment_vertices": "c/1/0/0",
    "body_vertices": "c/2/0/0",
    "template_vertices": "c/0/0",
    "garment_faces": "c/0/0",
    "poses": "c/0/0/0",
    "trans": "c/1/0",
    "parents": "c/0",
}


@pytest.mark.parametrize("key", CHUNKS)
def test_a_lost_chunk_is_an_error_not_zeros(data: DataSet, key: str) -> None:
    (data.path / "tube/bend" / key / CHUNKS[key]).unlink()
    with pytest.raises(InputError, match=rf"tube/bend cannot be read.*{key}: chunk \d is missing"):
        data.read("tube/bend")


def test_a_lost_array_is_an_error_even_where_clips_may_do_without(data: DataSet) -> None:
    (data.path / "tube/bend/poses").rename(data.path / "tube/bend/elsewhere")
    with pytest.raises(InputError, match=r"cannot be read.*poses"):
        data.read("tube/bend")


def test_a_flipped_bit_is_an_error(data: DataSet) -> None:
    file = data.path / "tube/bend/blend_weights/c/0/0"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"cannot be read.*blend_weights"):
        data.read("tube/bend")


def test_only_the_chunks_of_the_frames_are_read(data: DataSet, long_clip: Clip) -> None:
    (data.path / "tube/bend/garment_vertices/c/0/0/0").write_bytes(b"junk")
    part = data.reader("tube/bend").clip(32, 64)
    assert np.array_equal(part.garment.vertices, long_clip.garment.vertices[32:64])
    with pytest.raises(InputError, match="garment_vertices"):
        data.reader("tube/bend").clip(31, 33)


@pytest.mark.parametrize(("start", "stop"), [(0, 1), (31, 33), (40, 41), (69, 70), (5, 70), (10, 10)])
def test_any_frames_equal_those_of_the_whole(data: DataSet, long_clip: Clip, start: int, stop: int) -> None:
    reader = data.reader("tube/bend")
    assert (reader.n_frames, reader.frames_per_chunk) == (FRAMES, 32)
    if start == stop:
        with pytest.raises(InputError, match="no frames"):
            reader.clip(start, stop)
        return
    assert_same_clip(reader.clip(start, stop), long_clip.slice(slice(start, stop)))


@pytest.mark.parametrize("count", [1, 3, 20, 32, 70])
def test_parts_are_the_whole_from_a_store_an_npz_and_memory(
    data: DataSet, long_clip: Clip, tmp_path: Path, count: int
) -> None:
    readers = (
        data.reader("tube/bend"),
        NpzReader(save_clip(tmp_path / "walk.npz", long_clip)),
        LoadedReader(long_clip),
    )
    for reader in readers:
        first = 0
        for part in reader.parts(count):
            assert_same_clip(part, replace(long_clip.slice(slice(first, first + count)), name=part.name))
            first += part.n_frames
        assert first == FRAMES


def test_zeros_that_were_written_are_read(tmp_path: Path, long_clip: Clip) -> None:
    still = replace(long_clip, skeleton=replace(long_clip.skeleton, trans=np.zeros((FRAMES, 3), np.float32)))
    data = DataSet.create(tmp_path / "still")
    data.write("tube/still", still, split="train")
    assert np.array_equal(data.read("tube/still").skeleton.trans, still.skeleton.trans)


# writers that die, and writers at the same time

WRITER = """
import os, sys
sys.path[:0] = {paths!r}
from tests.helpers import synthetic
from imgtransfer.data import store
from imgtransfer.data.store import DataSet
name, die_after = sys.argv[1], int(sys.argv[2])
written, real = [], store.write_array

def write_array(*args, **options):
    real(*args, **options)
    written.append(1)
    if len(written) == die_after:
        os.kill(os.getpid(), 9)

store.write_array = write_array
DataSet.open_or_create({data!r}).write(name, synthetic.tube_clip(), split="train")
"""


def writer(data: Path, name: str, die_after: int = 0) -> subprocess.Popen[bytes]:
    paths = [str(ROOT)]
    program = WRITER.format(paths=paths, data=str(data))
    return subprocess.Popen([sys.executable, "-c", program, name, str(die_after)])


def test_a_writer_killed_between_arrays_leaves_no_clip_and_its_leftovers_go(
    tmp_path: Path, tube_clip: Clip
) -> None:
    path = tmp_path / "set"
    assert writer(path, "tube/dead", die_after=3).wait() == -9
    data = DataSet.open(path)
    assert data.names() == []
    (left,) = [entry for entry in (path / "tube").iterdir() if entry.is_dir()]
    assert left.name.startswith(".dead-")
    data.write("tube/alive", tube_clip, split="train")
    assert not left.exists()
    assert data.names() == ["tube/alive"]


def test_processes_write_different_clips_at_once(tmp_path: Path, tube_clip: Clip) -> None:
    names = [f"tube/{number}" for number in range(4)]
    for process in [writer(tmp_path / "set", name) for name in names]:
        assert process.wait() == 0
    data = DataSet.open(tmp_path / "set")
    assert data.names() == names
    for name in names:
        assert_same_clip(data.read(name), tube_clip)


def test_of_two_that_write_the_same_clip_one_wins(tmp_path: Path) -> None:
    place = LocalPlace(tmp_path)
    with place.whole_group("clip", {"by": 1}) as outer:
        (outer.root / "first").write_text("x")
        with place.whole_group("clip", {"by": 2}) as inner:
            (inner.root / "second").write_text("x")
    assert json.loads(place.read("clip/zarr.json"))["attributes"] == {"by": 1}
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["clip"]


@pytest.mark.parametrize("new_too", [False, True], ids=["", "and the new one"])
def test_a_clip_that_a_killed_writer_moved_aside_is_there_for_whoever_comes_next(
    data: DataSet, long_clip: Clip, capsys: pytest.CaptureFixture[str], new_too: bool
) -> None:
    """Where names cannot be exchanged, a kill between two renamings leaves the old clip under a hidden name."""
    folder = data.path / "tube"
    as_version_1(data)

    def move_aside(token: str) -> None:
        if new_too:
            shutil.copytree(folder / "bend", folder / f".bend-{token}")
        (folder / "bend").rename(folder / f".bend-{token}.old")

    move_aside("4242-81234567890")  # as earlier versions named it
    assert DataSet.open(data.path).names() == ["tube/bend"]
    move_aside("abcdefgh")
    assert main(["migrate", str(data.path)]) == 0
    assert "1 -> 2, 1 clips rewritten" in capsys.readouterr().out
    assert_same_clip(DataSet.open(data.path).read("tube/bend"), long_clip)
    move_aside("ijklmnop")
    assert [ref.name for ref in clip_refs(data.path)] == ["tube/bend"]
    move_aside("qrstuvwx")
    again = replace(long_clip, skeleton=replace(long_clip.skeleton, trans=long_clip.skeleton.trans + 1))
    DataSet.open(data.path).write("tube/bend", again, split="train")
    assert_same_clip(data.read("tube/bend"), again)
    assert sorted(path.name for path in folder.iterdir()) == ["bend", "zarr.json"]


# schema versions


def test_migration_keeps_every_value_and_can_be_stopped(
    data: DataSet, long_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    data.write("tube/other", long_clip, split="test")
    as_version_1(data)
    old = DataSet.open(data.path)
    with pytest.raises(InputError, match="schema version 1, which is read only; imgtransfer migrate"):
        old.write("tube/new", long_clip, split="train")
    replace(old, attributes=data.attributes).write("tube/bend", old.read("tube/bend"), split="train")
    standing = (data.path / "tube/bend/zarr.json").stat().st_mtime_ns
    assert main(["migrate", str(data.path)]) == 0
    assert "version 1 -> 2, 1 clips rewritten" in capsys.readouterr().out
    assert (data.path / "tube/bend/zarr.json").stat().st_mtime_ns == standing  # as after a stop
    new = DataSet.open(data.path)
    assert new.attributes["schema_version"] == 2
    assert new.names("test") == ["tube/other"]
    for name in new.names():
        assert_same_clip(new.read(name), long_clip)
        assert new.clip_attributes(name).schema_version == 2
    assert main(["migrate", str(data.path)]) == 0
    assert "version 2 already" in capsys.readouterr().out


def test_rejected_clips_are_listed_until_they_are_written(data: DataSet, long_clip: Clip) -> None:
    data.reject("tube/new", "it stretches", "a")
    data.reject("tube/worse", "it sinks", "b")
    assert data.rejected() == {
        "tube/new": {"reason": "it stretches", "made": "a"},
        "tube/worse": {"reason": "it sinks", "made": "b"},
    }
    data.write("tube/new", long_clip, split="train")
    assert list(DataSet.open(data.path).rejected()) == ["tube/worse"]
    assert data.names() == ["tube/bend", "tube/new"]


def test_a_clip_npz_is_read_by_frames(tmp_path: Path, tube_clip: Clip) -> None:
    save_clip(tmp_path / "walk.npz", tube_clip)
    (ref,) = clip_refs(tmp_path)
    assert (ref.name, ref.split, ref.reader().n_frames) == ("walk", None, tube_clip.n_frames)
    assert_same_clip(ref.reader().clip(2, 5), tube_clip.slice(slice(2, 5)))
    assert ref.still().n_frames == 1


def version_1_array(folder: Path, values: np.ndarray) -> StoredArray:
    """As version 1 wrote positions on the grid: differences over the whole clip, zeros left out, no checksum."""
    array = zarr.create_array(
        LocalStore(folder),
        shape=values.shape,
        dtype=np.int32,
        chunks=(32, *values.shape[1:]),
        fill_value=0,
        attributes={"encoding": "second-differences", "step": grid.STEP},
    )
    array[...] = grid.to_differences(values)
    place = LocalPlace(folder.parent)
    return StoredArray(place, folder.name, read_arrays(place, [folder.name], str(folder.parent))[0])


def test_arrays_of_version_1_are_read_by_frames(tmp_path: Path, long_clip: Clip) -> None:
    values = long_clip.body.vertices.copy()
    values[33:] = values[33]  # a chunk of zeros, which version 1 did not store
    stored = version_1_array(tmp_path, values)
    assert not (tmp_path / "c/2/0/0").exists()
    for start, stop in ((0, FRAMES), (0, 1), (31, 33), (64, 70)):
        assert np.array_equal(stored.read(start, stop), values[start:stop])


def test_zeros_of_version_1_are_not_taken_for_a_mesh(data: DataSet, long_clip: Clip) -> None:
    as_version_1(data)
    folder = data.path / "tube/bend/garment_vertices"
    shutil.rmtree(folder)
    version_1_array(folder, long_clip.garment.vertices)
    assert_same_clip(DataSet.open(data.path).read("tube/bend"), long_clip)
    (folder / "c/0/0/0").unlink()
    with pytest.raises(InputError, match="garment_vertices: it reads as zeros: chunks are missing"):
        DataSet.open(data.path).read("tube/bend")
