"""Data sets behind URLs: memory, a web server, a local cache of one. The same data set, the same clips."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from uuid import uuid4

import fsspec
import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip
from imgtransfer.data.location import as_url
from imgtransfer.data.source import open_clips
from imgtransfer.data.store import DataSet
from render import InputError
from tests.helpers import synthetic
from tests.helpers.clips import assert_same_clip


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *args: object) -> None:
        pass


@pytest.fixture
def memory() -> str:
    return f"memory://bucket/{uuid4()}"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """The URL of a web server that serves a data set with one clip of 40 frames."""
    DataSet.create(tmp_path / "set").write("tube/bend", synthetic.tube_clip(40), split="train")
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/set"
    server.shutdown()
    server.server_close()


def test_object_storage_holds_what_a_folder_holds(memory: str, tube_clip: Clip) -> None:
    data = DataSet.open_or_create(memory, title="tubes")
    data.write("tube/bend", tube_clip, split="train")
    data.write("tube/short", tube_clip.slice(slice(0, 3)), split="test")
    data.reject("tube/bad", "it stretches", "a")
    again = DataSet.open(Path(memory))  # as the command line has it: one slash less
    assert again.attributes["title"] == "tubes"
    assert (again.names(), again.names("test")) == (["tube/bend", "tube/short"], ["tube/short"])
    assert_same_clip(again.read("tube/bend"), tube_clip)
    assert again.splits() == {"tube/bend": "train", "tube/short": "test"}
    assert list(again.rejected()) == ["tube/bad"]
    assert [clip.name for clip in open_clips(memory, split="train")] == ["tube/bend"]


def test_a_clip_in_object_storage_stands_only_when_whole(memory: str, tube_clip: Clip) -> None:
    data = DataSet.create(memory)
    data.write("tube/bend", tube_clip, split="train")
    bad = replace(tube_clip)
    spoiled = replace(bad.skeleton, trans=np.array([{}], dtype=object))
    object.__setattr__(bad, "skeleton", spoiled)  # an array that Zarr cannot store
    with pytest.raises(Exception):  # noqa: B017, PT011 - whatever Zarr raises
        data.write("tube/new", bad, split="train")
    assert data.names() == ["tube/bend"]
    filesystem = fsspec.filesystem("memory")
    left = f"{memory.removeprefix('memory:/')}/tube/dead/body_vertices/zarr.json"
    filesystem.pipe_file(left, b"{}")  # as of a writer that died
    assert data.names() == ["tube/bend"]
    data.write("tube/dead", tube_clip.slice(slice(0, 2)), split="train")
    assert data.read("tube/dead").n_frames == 2


@pytest.mark.parametrize("chain", ["", "simplecache::"])
def test_a_web_server_is_read(served: str, chain: str, tmp_path: Path) -> None:
    data = DataSet.open(chain + served)
    assert data.names() == ["tube/bend"]
    clip = synthetic.tube_clip(40)
    assert_same_clip(data.read("tube/bend"), clip)
    assert np.array_equal(data.reader("tube/bend").clip(35, 37).body.vertices, clip.body.vertices[35:37])
    with pytest.raises(InputError, match="web servers can only be read"):
        data.write("tube/new", clip, split="train")
    (tmp_path / "set/tube/bend/body_vertices/c/1/0/0").unlink()
    if not chain:
        with pytest.raises(InputError, match="body_vertices: chunk 1 is missing"):
            DataSet.open(served).read("tube/bend")


def test_commands_take_urls(memory: str, tube_clip: Clip, capsys: pytest.CaptureFixture[str]) -> None:
    DataSet.create(memory).write("tube/bend", tube_clip, split="train")
    assert main(["inspect", memory]) == 0
    assert "1 clips, 6 frames" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("nope://x/y", "cannot be reached"),
        ("memory://nothing/here", "no data set"),
        ("http://127.0.0.1:9/set", "cannot be read .Cannot connect to host 127.0.0.1:9"),
    ],
)
def test_a_bad_url_is_one_line(url: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        DataSet.open(url)


class Hostile(BaseHTTPRequestHandler):
    """Answers by the first part of the path; a number is the status."""

    stop: threading.Event

    def log_message(self, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        what = self.path.split("/")[1]
        with suppress(ConnectionError):
            if what.isdecimal():
                self.send_response(int(what))
                self.send_header("Location", self.path)
                self.send_header("Content-Length", "0")
                self.end_headers()
            else:
                self.send_response(200)
                if what == "untrue":
                    self.send_header("Content-Length", "1000")
                self.end_headers()
                getattr(self, what)()

    def endless(self) -> None:
        while not self.stop.is_set():
            self.wfile.write(bytes(1 << 20))

    def untrue(self) -> None:
        self.wfile.write(b"{}")

    def dripping(self) -> None:
        while not self.stop.wait(0.1):
            self.wfile.write(b" ")

    def silent(self) -> None:
        self.stop.wait()

    def nonsense(self) -> None:
        self.wfile.write(b"<html>")


@pytest.fixture(scope="module")
def hostile() -> Iterator[str]:
    Hostile.stop = threading.Event()
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hostile)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    Hostile.stop.set()
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("404", "no data set"),
        ("401", "the server answers 401 Unauthorized"),
        ("403", "the server answers 403 Forbidden"),
        ("500", "the server answers 500 Internal Server Error"),
        ("302", "the server redirects in a circle"),
        ("endless", "the server sends more than 16777216 bytes"),
        ("untrue", "Response payload is not completed"),
        ("dripping", r"the server sent \d+ bytes in|no answer within"),
        ("silent", "no answer within 0.4 s"),
        ("nonsense", "not the metadata of a Zarr v3 group"),
    ],
)
def test_what_a_server_does_instead_of_answering_is_said_in_one_line(
    hostile: str, monkeypatch: pytest.MonkeyPatch, what: str, message: str
) -> None:
    monkeypatch.setattr("imgtransfer.data.http_files.PATIENCE", 0.4)
    with pytest.raises(InputError, match=message) as caught:
        DataSet.open(f"{hostile}/{what}")
    assert f"{hostile}/{what}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_chunk_larger_than_its_shape_is_not_taken_from_a_server(served: str, tmp_path: Path) -> None:
    chunk = tmp_path / "set/tube/bend/parents/c/0"
    chunk.write_bytes(chunk.read_bytes() + bytes(10_000))
    with pytest.raises(InputError, match=r"parents/c/0: .*more than \d+ bytes"):
        DataSet.open(served).read("tube/bend")


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("s3://bucket/set", "s3://bucket/set"),
        (Path("s3://bucket/set"), "s3://bucket/set"),
        (Path("simplecache::https://host/set"), "simplecache::https://host/set"),
        ("data/set", None),
        ("/data/set", None),
        (Path("C:/data/set"), None),
        ("file:///data/set", None),
    ],
)
def test_paths_and_urls_are_told_apart(text: str | Path, url: str | None) -> None:
    assert as_url(text) == url
