"""A data set that is one zip file: read like its folder, here and behind URLs, never written to, and never believed."""

from __future__ import annotations

import pickle
import re
import shutil
import struct
import threading
import zipfile
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import fsspec
import numpy as np
import pytest
import zarr
from zarr.storage import ZipStore

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, save_clip
from imgtransfer.data.location import place_at
from imgtransfer.data.migration import migrate
from imgtransfer.data.packing import pack
from imgtransfer.data.source import clip_refs, open_clips
from imgtransfer.data.store import DataSet
from render import InputError
from tests.helpers import synthetic
from tests.helpers.clips import assert_same_clip

CHUNK = "tube/bend/body_vertices/c/1/0/0"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set with two clips, of 40 and of 6 frames, and one that was rejected."""
    data = DataSet.create(tmp_path_factory.mktemp("folder") / "set.zarr", title="tubes")
    data.write("tube/bend", synthetic.tube_clip(40), split="train")
    data.write("tube/short", synthetic.tube_clip(6), split="test")
    data.reject("tube/bad", "it stretches", "a")
    return Path(data.path)


@pytest.fixture(scope="module")
def packed(folder: Path) -> Path:
    pack(DataSet.open(folder), target := folder.parent / "set.zarr.zip")
    return target


@pytest.fixture
def spoiled(packed: Path, tmp_path: Path) -> Path:
    """A copy, to spoil."""
    return Path(shutil.copy(packed, tmp_path / "set.zarr.zip"))


def again(
    path: Path, change: Callable[[zipfile.ZipInfo, bytes], tuple[zipfile.ZipInfo, bytes] | None]
) -> None:
    """Write a zip file anew, with each of its members as `change` makes it."""
    with zipfile.ZipFile(path) as old:
        members = [change(info, old.read(info)) for info in old.infolist()]
    with zipfile.ZipFile(path, "w") as new:
        for info, content in filter(None, members):
            new.writestr(info, content)


# reading


def test_a_zip_file_holds_what_its_folder_holds(folder: Path, packed: Path) -> None:
    data, kept = DataSet.open(packed), DataSet.open(folder)
    assert data.attributes == kept.attributes
    assert data.splits() == kept.splits() == {"tube/bend": "train", "tube/short": "test"}
    assert data.rejected() == kept.rejected()
    assert list(data.rejected()) == ["tube/bad"]
    for name in kept.names():
        assert_same_clip(data.read(name), kept.read(name))
    assert [clip.name for clip in open_clips(packed, split="test")] == ["tube/short"]
    assert not data.has("tube/none")


def test_zarr_reads_it_too(folder: Path, packed: Path) -> None:
    for key in ("body_vertices", "garment_faces"):
        stored = zarr.open_array(ZipStore(packed), path=f"tube/bend/{key}", mode="r")
        assert np.array_equal(stored[...], zarr.open_array(folder / "tube/bend" / key, mode="r")[...])


def test_what_zarr_writes_and_what_is_compressed_once_more_is_read(folder: Path, tmp_path: Path) -> None:
    for kind in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        path = tmp_path / f"{kind}.zip"
        with zipfile.ZipFile(path, "w", compression=kind) as archive:
            for file in sorted(folder.rglob("*")):  # folders too, as `zip -r` has them
                archive.write(file, file.relative_to(folder))
        assert_same_clip(DataSet.open(path).read("tube/bend"), DataSet.open(folder).read("tube/bend"))


def test_only_the_chunks_that_hold_the_frames_are_read(packed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = DataSet.open(packed).reader("tube/bend")
    reader.clip(0, 1)  # metadata, and what does not move
    place, fetched = place_at(packed), []
    read = type(place.file).read
    monkeypatch.setattr(
        type(place.file), "read", lambda self, spans: fetched.extend(spans) or read(self, spans)
    )
    clip = reader.clip(35, 37)
    assert np.array_equal(clip.body.vertices, synthetic.tube_clip(40).body.vertices[35:37])
    with zipfile.ZipFile(packed) as archive:
        infos = [info for info in archive.infolist() if "/bend/" in info.filename and "/c/1" in info.filename]
    assert sorted(start for start, _ in fetched) == sorted(info.header_offset for info in infos)


def test_a_reader_travels_to_other_processes(packed: Path) -> None:
    reader = DataSet.open(packed).reader("tube/short")
    assert_same_clip(pickle.loads(pickle.dumps(reader)).clip(), reader.clip())


# behind URLs


class Parts(SimpleHTTPRequestHandler):
    """Sends the part of a file that is asked for, as web servers do and Python's does not."""

    whole = False

    def log_message(self, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if self.whole or asked is None or not path.is_file():
            super().do_GET()
            return
        start, stop = int(asked[1]), int(asked[2]) + 1
        part = path.read_bytes()[start:stop]
        self.send_response(206)
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        self.wfile.write(part)


class Whole(Parts):
    whole = True


@pytest.fixture(scope="module", params=[Parts, Whole])
def served(request: pytest.FixtureRequest, packed: Path) -> Iterator[tuple[str, bool]]:
    """The URL of the zip file on a web server, and whether it sends parts of files."""
    handler = partial(request.param, directory=str(packed.parent))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/set.zarr.zip", not request.param.whole
    server.shutdown()
    server.server_close()


def test_a_web_server_is_asked_for_parts(served: tuple[str, bool], folder: Path) -> None:
    url, parts = served
    whole = DataSet.open(folder).read("tube/bend")
    assert_same_clip(DataSet.open(f"simplecache::{url}").read("tube/bend"), whole)
    if not parts:
        with pytest.raises(InputError, match=r"sends no parts of files; put simplecache:: before the URL"):
            DataSet.open(url)
        return
    assert_same_clip(DataSet.open(url).read("tube/bend"), whole)
    assert_same_clip(DataSet.open(f"{url}?download=1").read("tube/bend"), whole)
    with pytest.raises(InputError, match=r"no data set; wanted is"):
        DataSet.open(url.replace("set", "none"))
    with pytest.raises(InputError, match=r"is only read; .*python -m zipfile -e set.zarr.zip set.zarr$"):
        DataSet.open_or_create(url)


def test_object_storage(packed: Path, folder: Path) -> None:
    filesystem = fsspec.filesystem("memory")
    filesystem.pipe_file("/zips/set.zarr.zip", packed.read_bytes())
    assert_same_clip(
        DataSet.open("memory://zips/set.zarr.zip").read("tube/bend"), DataSet.open(folder).read("tube/bend")
    )
    filesystem.pipe_file("/zips/set.zarr.zip", b"PK")  # another file in its place is noticed
    with pytest.raises(InputError, match="not a zip file, or one that was cut short"):
        DataSet.open("memory://zips/set.zarr.zip")


# writing


def test_the_same_data_give_the_same_file(folder: Path, packed: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy", copy_function=shutil.copyfile)  # with other times
    (copy / "tube/.bend-left").mkdir()  # by a writer that died
    (copy / "tube/.bend-left/zarr.json").write_text("{}")
    pack(DataSet.open(copy), tmp_path / "copy.zip")
    assert (tmp_path / "copy.zip").read_bytes() == packed.read_bytes()
    with zipfile.ZipFile(packed) as archive:
        assert {info.compress_type for info in archive.infolist()} == {zipfile.ZIP_STORED}
        assert archive.namelist() == sorted(archive.namelist())
        archive.extractall(tmp_path / "back")
    files = {file.relative_to(folder) for file in folder.rglob("*") if file.is_file()}
    assert files == {f.relative_to(tmp_path / "back") for f in (tmp_path / "back").rglob("*") if f.is_file()}
    assert all((folder / file).read_bytes() == (tmp_path / "back" / file).read_bytes() for file in files)
    pack(DataSet.open(packed), tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == packed.read_bytes()


def test_export_packs_all_clips_or_those_that_are_chosen(
    folder: Path, packed: Path, tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "all.zarr.zip"
    assert main(["export", str(folder), "--out", str(out)]) == 0
    assert "2 clips" in capsys.readouterr().out
    assert out.read_bytes() == packed.read_bytes()
    assert main(["export", str(packed), "--split", "test", "--out", f"{tmp_path}/some.zip"]) == 0
    some = DataSet.open(tmp_path / "some.zip")
    assert (some.names(), some.rejected()) == (["tube/short"], {})
    assert_same_clip(some.read("tube/short"), DataSet.open(folder).read("tube/short"))
    save_clip(tmp_path / "a.npz", tube_clip)
    for argv, message in (
        (["export", str(tmp_path / "a.npz"), "--out", str(out)], "only a data set becomes one zip file"),
        (["export", str(folder), "--step", "2", "--out", str(out)], "--step 2: a .zip holds every frame"),
    ):
        assert main(argv) == 2
        assert message in capsys.readouterr().err


def test_nothing_is_written_into_one(
    spoiled: Path, tmp_path: Path, tube_clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    before = spoiled.read_bytes()
    save_clip(tmp_path / "tube_new.npz", tube_clip)
    new = tmp_path / "none yet.zip"
    how = "is only read; give a folder to write to, or unpack the file into one, where it lies, by: "
    for target, command in (
        (spoiled, "python -m zipfile -e set.zarr.zip set.zarr"),
        (new, "python -m zipfile -e 'none yet.zip' 'none yet'"),
    ):
        assert main(["import", f"{tmp_path}/tube_new.npz", "--split", "train", "--to", str(target)]) == 2
        assert f"{how}{command}\n" in capsys.readouterr().err
        with pytest.raises(InputError, match=re.escape(how)):
            DataSet.create(target)
    data = DataSet.open(spoiled)
    for write in (
        lambda: data.write("tube/new", tube_clip, split="train"),
        lambda: data.reject("tube/new", "it stretches", "b"),
    ):
        with pytest.raises(InputError, match=re.escape(how)):
            write()
    assert migrate(spoiled) == ([], 2)
    again(
        spoiled, lambda info, content: (info, content.replace(b'"schema_version": 2', b'"schema_version": 1'))
    )
    assert_same_clip(DataSet.open(spoiled).read("tube/short"), synthetic.tube_clip(6))
    with pytest.raises(InputError, match=re.escape(how)):
        migrate(spoiled)
    assert not new.exists()
    assert DataSet.open(spoiled).names() == ["tube/bend", "tube/short"]
    assert len(before) == spoiled.stat().st_size


# damage


def test_a_flipped_bit_is_noticed(spoiled: Path) -> None:
    with zipfile.ZipFile(spoiled) as archive:
        info = archive.getinfo(CHUNK)
    content = bytearray(spoiled.read_bytes())
    content[info.header_offset + 30 + len(CHUNK) + 5] ^= 1
    spoiled.write_bytes(content)
    data = DataSet.open(spoiled)
    with pytest.raises(InputError, match=rf"clip tube/bend cannot be read: .*{CHUNK}: damaged") as caught:
        data.read("tube/bend")
    assert "\n" not in str(caught.value)
    assert data.read("tube/short").n_frames == 6
    assert data.reader("tube/bend").clip(0, 32).n_frames == 32


@pytest.mark.parametrize("left", [0, 1, 21, 1000, -1, -30])
def test_a_file_that_was_cut_short(spoiled: Path, left: int) -> None:
    spoiled.write_bytes(spoiled.read_bytes()[:left])
    with pytest.raises(
        InputError, match=r"set.zarr.zip: not a zip file, or one that was cut short"
    ) as caught:
        clip_refs(spoiled)
    assert "\n" not in str(caught.value)


def _central(path: Path, name: str, offset: int, content: bytes) -> None:
    """Overwrite what the directory says of a member; header fields as in the format's description, 4.3.12."""
    data = bytearray(path.read_bytes())
    at = data.rfind(name.encode()) - 46
    assert data[at : at + 4] == b"PK\1\2"
    data[at + offset : at + offset + len(content)] = content
    path.write_bytes(data)


def _named(name: str) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(name, b"x")

    return spoil


def _twice(path: Path) -> None:
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("zarr.json", b"{}")


def _huge(path: Path) -> None:
    """A member that says that it is larger than anything."""
    with zipfile.ZipFile(path, "a", compression=zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("tube/bomb/zarr.json", bytes(1 << 25))


FAULTS = {
    "no zip file": (lambda path: path.write_bytes(b"nothing of the kind"), "not a zip file"),
    "another format": (lambda path: again(path, lambda i, c: None), "no data set; wanted is"),
    "in a folder of its own": (
        lambda path: again(path, lambda i, c: (zipfile.ZipInfo(f"set/{i.filename}"), c)),
        "no data set; wanted is",
    ),
    "a member outside": (_named("../secret"), "'../secret' has a name that means a place outside"),
    "a member at the root": (_named("/etc/passwd"), "has a name that means a place outside"),
    "backslashes": (_named("a\\b"), "has a name that is none"),
    "control codes": (_named("a\x1b[2Jb"), "has a name that is none"),
    "one name twice": (_twice, "member 'zarr.json' is there twice"),
    "encrypted": (lambda path: _central(path, CHUNK, 8, b"\1\0"), f"{CHUNK}' is encrypted"),
    "an unknown compression": (lambda path: _central(path, CHUNK, 10, b"\x63\0"), "is compressed in a way"),
    "a size that cannot be": (
        lambda path: _central(path, CHUNK, 20, struct.pack("<II", 9, 1 << 30)),
        "has 9 bytes for 1073741824",
    ),
    "bytes of others": (
        lambda path: _central(path, CHUNK, 20, struct.pack("<II", 1 << 30, 1 << 30)),
        "lies outside the file or over another one",
    ),
    "another's place": (lambda path: _central(path, CHUNK, 42, bytes(4)), "lies outside the file or over"),
    "another checksum": (lambda path: _central(path, CHUNK, 16, bytes(4)), f"{CHUNK}: damaged"),
    "a bomb": (_huge, "tube/bomb/zarr.json: 33554432 bytes, where at most 16777216 are wanted"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_zip_file_that_no_data_set_is(spoiled: Path, fault: str) -> None:
    spoil, message = FAULTS[fault]
    spoil(spoiled)
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        open_clips(spoiled)
    assert "\n" not in str(caught.value)
    assert str(spoiled) in str(caught.value)


def test_a_deflated_member_never_grows_beyond_its_size(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "set.zip"
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(folder.rglob("*.json")):
            archive.write(file, file.relative_to(folder))
        archive.writestr("tube/bend/x", bytes(1 << 20))
    _central(path, "tube/bend/x", 24, struct.pack("<I", 2000))
    with pytest.raises(InputError, match="tube/bend/x: damaged"):
        place_at(path).read("tube/bend/x")


def test_a_directory_of_gigabytes_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "set.zip"
    size = 1 << 31
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, 1, 1, size, 0, 0)
    with path.open("wb") as file:
        file.truncate(size)
        file.seek(size)
        file.write(end)
    with pytest.raises(InputError, match="a directory of 2147483648 bytes"):
        DataSet.open(path)


def test_commands_read_one_and_say_what_is_wrong_with_it_in_one_line(
    spoiled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["import", str(spoiled), "--to", f"{tmp_path}/new"]) == 0
    assert DataSet.open(tmp_path / "new").splits() == DataSet.open(spoiled).splits()
    spoiled.write_bytes(b"PK")
    for command in (["inspect"], ["export", "--out", "out.glb"], ["import", "--to", f"{tmp_path}/newer"]):
        capsys.readouterr()
        assert main([*command, str(spoiled)]) == 2
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        assert str(spoiled) in err
