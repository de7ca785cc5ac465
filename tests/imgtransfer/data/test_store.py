"""The data set: lossless, whole or not at all, and clear about what it cannot read."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr

from imgtransfer.data import grid
from imgtransfer.data.clip import Clip, load_clip, save_clip
from imgtransfer.data.source import open_clips
from imgtransfer.data.store import DataSet
from render import InputError
from tests.helpers.clips import assert_same_clip, on_grid


@pytest.fixture
def data_set(tmp_path: Path, tube_clip: Clip) -> DataSet:
    data = DataSet.create(tmp_path / "data", title="tubes", licence="CC0-1.0", source="synthetic")
    data.write("tube/bend", tube_clip, split="train")
    data.write("tube/other", tube_clip.slice(slice(0, 3)), split="test")
    return data


@pytest.mark.parametrize("rounded", [False, True])
def test_a_clip_goes_to_npz_to_data_set_and_back_unchanged(
    tmp_path: Path, tube_clip: Clip, rounded: bool
) -> None:
    clip = on_grid(tube_clip) if rounded else tube_clip
    data = DataSet.create(tmp_path / "data")
    data.write("tube/bend", load_clip(save_clip(tmp_path / "bend.npz", clip)), split="train")
    encoded = "encoding" in zarr.open_array(data.path / "tube/bend/garment_vertices", mode="r").attrs
    assert encoded == rounded
    back = load_clip(save_clip(tmp_path / "again.npz", data.read("tube/bend")))
    assert_same_clip(back, clip)


def test_a_clip_without_a_garment_or_skinning_is_kept(tmp_path: Path, tube_clip: Clip) -> None:
    bare = replace(
        tube_clip,
        garment=None,
        skeleton=replace(tube_clip.skeleton, blend_weights=None, poses=None, trans=None),
        fps=29.97,
    )
    data = DataSet.create(tmp_path / "data")
    data.write("tube/bare", bare, split="test")
    assert_same_clip(data.read("tube/bare"), bare)


def test_names_splits_and_attributes(data_set: DataSet) -> None:
    again = DataSet.open(data_set.path)
    assert again.names() == ["tube/bend", "tube/other"]
    assert again.names("test") == ["tube/other"]
    assert again.split("tube/bend") == "train"
    assert (again.attributes["units"], again.attributes["up"], again.attributes["title"]) == (
        "m",
        "y",
        "tubes",
    )
    attributes = again.clip_attributes("tube/other")
    assert (attributes.frames, attributes.fps, attributes.licence) == (3, 30.0, "CC0-1.0")
    assert again.read("tube/other").name == "tube/other"


def test_the_store_is_read_by_plain_zarr_without_warnings(
    data_set: DataSet, recwarn: pytest.WarningsRecorder
) -> None:
    root = zarr.open_group(data_set.path, mode="r")
    assert sorted(root["tube"].group_keys()) == ["bend", "other"]
    assert root["tube/bend/body_vertices"].shape == (6, 128, 3)
    assert [str(w.message) for w in recwarn] == []


def test_writing_again_replaces_the_clip(data_set: DataSet, tube_clip: Clip) -> None:
    data_set.write("tube/bend", tube_clip.slice(slice(0, 2)), split="test")
    assert (data_set.read("tube/bend").n_frames, data_set.split("tube/bend")) == (2, "test")


def test_a_failed_write_leaves_nothing(data_set: DataSet, tube_clip: Clip) -> None:
    bad = replace(tube_clip)
    spoiled = replace(bad.skeleton, trans=np.array([{}], dtype=object))
    object.__setattr__(bad, "skeleton", spoiled)  # an array that Zarr cannot store
    with pytest.raises(Exception):  # noqa: B017, PT011 - whatever Zarr raises
        data_set.write("tube/new", bad, split="train")
    assert data_set.names() == ["tube/bend", "tube/other"]
    assert sorted(p.name for p in (data_set.path / "tube").iterdir()) == ["bend", "other", "zarr.json"]


def test_another_schema_version_names_both(data_set: DataSet) -> None:
    path = data_set.path / "zarr.json"
    stored = json.loads(path.read_text())
    stored["attributes"]["schema_version"] = 7
    path.write_text(json.dumps(stored))
    with pytest.raises(InputError, match=r"schema version 7.*reads versions 1 and 2"):
        DataSet.open(data_set.path)


def test_damaged_metadata_is_an_input_error(data_set: DataSet) -> None:
    (data_set.path / "zarr.json").write_text("{")
    with pytest.raises(InputError, match="not the metadata"):
        DataSet.open(data_set.path)


def test_a_missing_array_is_named(data_set: DataSet) -> None:
    (data_set.path / "tube/bend/body_vertices").rename(data_set.path / "tube/bend/elsewhere")
    with pytest.raises(InputError, match=r"clip tube/bend cannot be read.*body_vertices"):
        data_set.read("tube/bend")


def test_a_damaged_chunk_is_an_input_error(data_set: DataSet) -> None:
    (data_set.path / "tube/bend/body_vertices/c/0/0/0").write_bytes(b"junk")
    with pytest.raises(InputError, match="damaged"):
        data_set.read("tube/bend")


@pytest.mark.parametrize("name", ["bend", "a/b/c", "../x/y", "tube/.hidden", "tube/", ""])
def test_a_bad_clip_name_is_refused(data_set: DataSet, tube_clip: Clip, name: str) -> None:
    with pytest.raises(InputError, match="wanted <garment>/<clip>"):
        data_set.write(name, tube_clip, split="train")


def test_create_refuses_a_folder_in_use_and_open_a_folder_without_data(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        DataSet.create(tmp_path)
    with pytest.raises(InputError, match="no data set"):
        DataSet.open(tmp_path)


def test_open_clips_reads_data_sets_files_and_folders(
    tmp_path: Path, data_set: DataSet, tube_clip: Clip
) -> None:
    save_clip(tmp_path / "npz/walk.npz", tube_clip)
    save_clip(tmp_path / "npz/turn.npz", tube_clip)
    assert [c.name for c in open_clips(data_set.path)] == ["tube/bend", "tube/other"]
    assert [c.name for c in open_clips(data_set.path, split="test")] == ["tube/other"]
    assert [c.name for c in open_clips(data_set.path, names=["*/be*"])] == ["tube/bend"]
    assert [c.name for c in open_clips(tmp_path / "npz")] == ["turn", "walk"]
    assert [c.name for c in open_clips(tmp_path / "npz", exclude=["w*"])] == ["turn"]
    assert [c.name for c in open_clips(tmp_path / "npz/walk.npz")] == ["walk"]


def test_open_clips_says_what_is_there(tmp_path: Path, data_set: DataSet, tube_clip: Clip) -> None:
    with pytest.raises(InputError, match=r"no clip matches \(split val\); there are tube/bend, tube/other"):
        open_clips(data_set.path, split="val")
    with pytest.raises(InputError, match=r"no clip matches \(names dress\*\)"):
        open_clips(data_set.path, names=["dress*"])
    with pytest.raises(InputError, match="no such file or folder"):
        open_clips(tmp_path / "absent")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="neither a data set"):
        open_clips(tmp_path / "empty")
    with pytest.raises(InputError, match="only data sets have splits"):
        open_clips(save_clip(tmp_path / "walk.npz", tube_clip), split="train")


def test_the_grid_is_exact_and_knows_its_limits() -> None:
    points = np.float32([[0.1, -1.7, 3.3], [0.2, -1.6, 120.0], [0.25, 0.0, -240.5]])
    rounded = grid.round_to_grid(points)
    assert np.abs(rounded - points).max() <= grid.STEP / 2
    assert grid.lies_on_grid(rounded)
    assert not grid.lies_on_grid(points)
    np.testing.assert_array_equal(grid.from_differences(grid.to_differences(rounded), grid.STEP), rounded)
    assert not grid.lies_on_grid(rounded.astype(np.float64))
    assert not grid.lies_on_grid(np.float32([2.0**13]))
    assert not grid.lies_on_grid(np.float32([np.nan]))
    assert not grid.lies_on_grid(np.float32([-0.0]))  # its sign would be lost
    assert grid.lies_on_grid(np.zeros((0, 3), np.float32))
