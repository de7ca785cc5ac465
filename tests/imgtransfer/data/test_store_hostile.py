"""Metadata and chunks of data sets that say what cannot be: one line that names the file and the key, at once."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numcodecs
import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.arrays import _size_inside
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from render import InputError

CLIP, ARRAY = "tube/bend/zarr.json", "tube/bend/body_vertices/zarr.json"


@pytest.fixture(scope="module")
def stored(tube_clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stored") / "set"
    data = DataSet.create(folder)
    data.write("tube/bend", tube_clip, split="train")
    data.write("tube/other", tube_clip, split="test")
    data.reject("tube/bad", "it stretches", "a")
    return folder


@pytest.fixture
def folder(stored: Path, tmp_path: Path) -> Path:
    """A copy of the data set, to spoil."""
    return Path(shutil.copytree(stored, tmp_path / "set"))


def change(file: Path, spoil: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(file.read_text())
    spoil(content)
    file.write_text(json.dumps(content))


def attributes(**changed: object) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["attributes"].update(changed)


def without(key: str) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["attributes"].pop(key)


def shape(*lengths: int) -> Callable[[dict[str, Any]], object]:
    return lambda content: content.update(shape=list(lengths))


def chunks(*lengths: int) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["chunk_grid"]["configuration"].update(chunk_shape=list(lengths))


GROUPS = {
    "no split": (without("split"), "split: Field required"),
    "no frames": (without("frames"), "frames: Field required"),
    "no fps": (without("fps"), "fps: Field required"),
    "a split of another kind": (attributes(split=["train"]), "split: .*valid string"),
    "an empty split": (attributes(split=""), "split: "),
    "frames in words": (attributes(frames="6"), "frames: .*valid integer, found '6'"),
    "a share of a frame": (attributes(frames=5.5), "frames: "),
    "no frame": (attributes(frames=0), "frames: "),
    "fewer frames than are stored": (attributes(frames=3), "frames is 3, but garment_vertices has 6"),
    "an endless frame rate": (attributes(fps=float("inf")), "fps: "),
    "a negative frame rate": (attributes(fps=-30), "fps: "),
    "info of another kind": (attributes(info=[1]), "info: "),
    "info that is no text": (attributes(info={"source": {}}), "info.source: "),
    "an array that no clip has": (attributes(arrays=["../../secret"]), "arrays: no clip has an array"),
    "an array listed twice": (attributes(arrays=["body_rest", "body_rest"]), "arrays: .*twice"),
    "too few arrays": (attributes(arrays=["body_rest"]), "arrays: lacks template_vertices"),
    "attributes of another kind": (lambda c: c.update(attributes=[]), "not the metadata of a Zarr v3 group"),
    "no group": (lambda c: c.update(node_type="array"), "not the metadata of a Zarr v3 group"),
}
ARRAYS = {
    "petabytes": (shape(6, 2**45, 3), "is of no array"),
    "terabytes": (shape(6, 2**40, 3), r"body_vertices must have shape \(any, 128, 3\)"),
    "another number of frames": (shape(7, 128, 3), "frames is 6, but body_vertices has 7"),
    "a negative length": (shape(6, -128, 3), "is of no array"),
    "a single number": (shape(), "shape: "),
    "another number of axes": (shape(6, 384), "do not divide"),
    "chunks of nothing": (chunks(0, 128, 3), "do not divide"),
    "chunks of terabytes": (chunks(6, 2**40, 3), "larger than 2 GiB"),
    "chunks of other axes": (chunks(6), "do not divide"),
    "chunks of another size": (chunks(3, 128, 3), "chunk 0 holds"),
    "one chunk a number": (chunks(1, 1, 1), "bytes, where at most 4100"),
    "text": (lambda c: c.update(data_type="fixed_length_utf32"), "data_type: "),
    "truths": (lambda c: c.update(data_type="bool"), "data_type: "),
    "a wider type": (lambda c: c.update(data_type="float64", attributes={}), "chunk 0 holds"),
    "an unknown codec": (lambda c: c["codecs"].append({"name": "pickle"}), "codecs .*pickle"),
    "no codec": (lambda c: c.update(codecs=[]), "codecs: "),
    "a codec's own nonsense": (lambda c: c["codecs"][1]["configuration"].update(clevel="x"), "body_vertices"),
    "an unknown encoding": (lambda c: c.update(attributes={"encoding": "x"}), "attributes.encoding: "),
    "an encoding without a step": (
        lambda c: c.update(data_type="int32", attributes={"encoding": "second-differences"}),
        "has a step",
    ),
    "a group": (lambda c: c.update(node_type="group"), "node_type: "),
    "storage transformers": (lambda c: c.update(storage_transformers=[{}]), "storage_transformers"),
}


@pytest.mark.parametrize("fault", GROUPS)
def test_metadata_of_a_clip(folder: Path, fault: str) -> None:
    spoil, message = GROUPS[fault]
    change(folder / CLIP, spoil)
    with pytest.raises(InputError, match=message) as caught:
        DataSet.open(folder).read("tube/bend")
    assert str(folder / CLIP) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("fault", ARRAYS)
def test_metadata_of_an_array(folder: Path, fault: str) -> None:
    spoil, message = ARRAYS[fault]
    change(folder / ARRAY, spoil)
    with pytest.raises(InputError, match=message) as caught:
        DataSet.open(folder).read("tube/bend")
    assert str(folder) in str(caught.value)
    assert "tube/bend" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [b"", b"null", b"[" * 100_000, b"\xff", b'{"attributes": {"split": ' + b"9" * 5000 + b"}}", b"{}"],
)
@pytest.mark.parametrize("file", ["zarr.json", CLIP, ARRAY, "rejected/tube__bad.json"])
def test_metadata_that_are_none(folder: Path, file: str, content: bytes) -> None:
    (folder / file).write_bytes(content)

    def look() -> None:
        data = DataSet.open(folder)
        data.rejected()
        data.read("tube/bend")

    with pytest.raises(InputError, match=file) as caught:
        look()
    assert "\n" not in str(caught.value)


def test_huge_metadata_are_not_read(folder: Path) -> None:
    with (folder / CLIP).open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match=r"bend/zarr.json: 1099511627776 bytes, where at most 16777216"):
        clip_refs(folder)


def test_pipes_in_place_of_files_are_not_waited_for(folder: Path) -> None:
    chunk = folder / "tube/bend/parents/c/0"
    chunk.unlink()
    os.mkfifo(chunk)
    with pytest.raises(InputError, match="parents/c/0: is a pipe"):
        DataSet.open(folder).read("tube/bend")


def test_names_that_mean_other_places_are_no_clips(folder: Path) -> None:
    assert not DataSet.open(folder).has("../set/tube/bend")
    (folder / "tube/bend").rename(folder / "tube/be\x1b[2Jnd")
    with pytest.raises(InputError, match="a clip of the name") as caught:
        clip_refs(folder)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("codecs", [["bytes", "zstd"], ["bytes", "blosc"], ["bytes"]])
def test_what_a_chunk_holds_is_known_before_it_is_decoded(codecs: list[str]) -> None:
    for size in (1, 200, 300, 70_000, 3_000_000):
        content = np.zeros(size, np.uint8).tobytes()
        if codecs[-1] == "zstd":
            content = bytes(numcodecs.Zstd().encode(content))
        elif codecs[-1] == "blosc":
            content = bytes(numcodecs.Blosc().encode(content))
        assert _size_inside(content, codecs) == size
        assert _size_inside(content + b"1234", [*codecs, "crc32c"]) == size
    if len(codecs) > 1:
        assert _size_inside(b"junk", codecs) == -1


def test_a_bomb_is_not_decoded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = bytes(numcodecs.Blosc(cname="zstd").encode(bytes(1 << 22)))
    (folder / "tube/bend/parents/c/0").write_bytes(bomb + bytes(4))
    with pytest.raises(InputError, match=r"parents: chunk 0 holds 4194304 bytes, 16 are wanted"):
        DataSet.open(folder).read("tube/bend")
    monkeypatch.setattr("imgtransfer.data.arrays.available_bytes", lambda: 1000)
    with pytest.raises(InputError, match="GiB of memory are needed"):
        DataSet.open(folder).read("tube/other")


def test_one_damaged_clip_does_not_keep_the_others_from_anything(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "tube/bend/body_vertices/c/0/0/0").write_bytes(b"junk")
    assert main(["import", str(folder), "--to", str(tmp_path / "new")]) == 2
    assert "1 of 2 clips were not imported" in (error := capsys.readouterr().err)
    assert "clip tube/bend cannot be read" in error
    assert DataSet.open(tmp_path / "new").names() == ["tube/other"]
    assert main(["inspect", str(folder)]) == 2
    shown = capsys.readouterr()
    assert "1 of 2 clips cannot be read: " in shown.err
    assert "clip tube/bend cannot be read" in shown.err
    assert "unreadable" in shown.out
    assert "2 clips, 6 frames" in shown.out
    for file in ("zarr.json", CLIP, "tube/other/zarr.json"):
        change(folder / file, attributes(schema_version=1))
    assert main(["migrate", str(folder)]) == 2
    assert "1 of 2 clips are damaged and stay as they are" in capsys.readouterr().err
    data = DataSet.open(folder)
    assert data.attributes["schema_version"] == 1  # until the damaged one is gone
    assert data.clip_attributes("tube/other").schema_version == 2
    shutil.rmtree(folder / "tube/bend")
    assert main(["migrate", str(folder)]) == 0
    assert DataSet.open(folder).attributes["schema_version"] == 2
