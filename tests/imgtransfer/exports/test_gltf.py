"""The GLB: parsed by hand here, chunk by chunk, and loaded by trimesh."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment, Skeleton
from imgtransfer.exports import animated_glb, written_animation
from render import InputError
from tests.helpers.clips import with_arrays


def parse(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON and the binary chunk, after checking the container."""
    data = path.read_bytes()
    assert struct.unpack_from("<4sII", data) == (b"glTF", 2, len(data))
    length, kind = struct.unpack_from("<I4s", data, 12)
    assert (kind, length % 4) == (b"JSON", 0)
    document = json.loads(data[20 : 20 + length])
    binary_length, kind = struct.unpack_from("<I4s", data, 20 + length)
    assert (kind, binary_length % 4) == (b"BIN\0", 0)
    binary = data[28 + length :]
    assert len(binary) == binary_length
    assert document["buffers"] == [{"byteLength": binary_length}]
    return document, binary


def values(document: dict[str, Any], binary: bytes, accessor: int) -> np.ndarray:
    entry = document["accessors"][accessor]
    view = document["bufferViews"][entry["bufferView"]]
    width = {"SCALAR": 1, "VEC3": 3}[entry["type"]]
    dtype = {5126: "<f4", 5125: "<u4"}[entry["componentType"]]
    assert view["byteOffset"] % 4 == 0
    found = np.frombuffer(binary, dtype, entry["count"] * width, view["byteOffset"]).reshape(-1, width)
    assert view["byteLength"] == found.nbytes
    if "min" in entry:
        np.testing.assert_array_equal(found.min(0), np.float32(entry["min"]))
        np.testing.assert_array_equal(found.max(0), np.float32(entry["max"]))
    return found


def test_every_frame_comes_back_in_vertex_order(tmp_path: Path, tube_clip: Clip) -> None:
    document, binary = parse(animated_glb(tmp_path / "tube.glb", tube_clip))
    wanted = {
        "body": (tube_clip.body.vertices, tube_clip.body.faces),
        "garment": (tube_clip.garment.vertices, tube_clip.template.faces),
    }
    assert [node["name"] for node in document["nodes"]] == ["body", "garment"]
    for node in document["nodes"]:
        mesh = document["meshes"][node["mesh"]]
        (primitive,) = mesh["primitives"]
        vertices, faces = wanted[node["name"]]
        base = values(document, binary, primitive["attributes"]["POSITION"])
        np.testing.assert_array_equal(base, vertices[0])
        np.testing.assert_array_equal(values(document, binary, primitive["indices"]).reshape(-1, 3), faces)
        assert mesh["weights"] == [0.0] * len(primitive["targets"]) == [0.0] * 5
        for frame, target in enumerate(primitive["targets"], start=1):
            moved = base + values(document, binary, target["POSITION"])
            np.testing.assert_allclose(moved, vertices[frame], atol=1e-6)
        normals = values(document, binary, primitive["attributes"]["NORMAL"])
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)


def test_the_animation_shows_frame_k_at_time_k(tmp_path: Path, tube_clip: Clip) -> None:
    path = tmp_path / "tube.glb"
    with written_animation(path, n_frames=tube_clip.n_frames, step=2) as add:
        add(tube_clip)
    document, binary = parse(path)
    (animation,) = document["animations"]
    assert [channel["target"] for channel in animation["channels"]] == [
        {"node": 0, "path": "weights"},
        {"node": 1, "path": "weights"},
    ]
    for sampler in animation["samplers"]:
        np.testing.assert_allclose(values(document, binary, sampler["input"]).ravel(), [0, 2 / 30, 4 / 30])
        weights = values(document, binary, sampler["output"]).reshape(3, 2)
        np.testing.assert_array_equal(weights, [[0, 0], [1, 0], [0, 1]])


def test_long_clips_keep_every_frame(tmp_path: Path, tube_clip: Clip) -> None:
    many = np.arange(200) % tube_clip.n_frames
    per_frame = ("garment_vertices", "body_vertices", "poses", "trans")
    long = with_arrays(tube_clip, **{key: tube_clip.arrays()[key][many] for key in per_frame})
    document, _ = parse(animated_glb(tmp_path / "long.glb", long))
    assert [len(mesh["primitives"][0]["targets"]) for mesh in document["meshes"]] == [199, 199]


def test_more_than_the_format_holds_is_refused(tmp_path: Path, tube_clip: Clip) -> None:
    frames = 30_000  # the weights alone: 2 meshes, 4 bytes, squared
    endless = replace(
        tube_clip,
        garment=Garment(np.broadcast_to(tube_clip.garment.vertices[:1], (frames, 192, 3))),
        body=replace(tube_clip.body, vertices=np.broadcast_to(tube_clip.body.vertices[:1], (frames, 128, 3))),
        skeleton=Skeleton(),
    )
    with pytest.raises(
        InputError, match=r"long.glb: 30000 frames of 320 vertices are 6.9 GiB.*take fewer with step"
    ):
        animated_glb(tmp_path / "long.glb", endless)
    assert not (tmp_path / "long.glb").exists()


def test_one_frame_needs_no_animation(tmp_path: Path, tube_clip: Clip) -> None:
    document, _ = parse(animated_glb(tmp_path / "still.glb", tube_clip.slice(slice(0, 1))))
    assert "animations" not in document
    assert "targets" not in document["meshes"][0]["primitives"][0]


@pytest.mark.parametrize("with_garment", [True, False])
def test_trimesh_loads_it(tmp_path: Path, tube_clip: Clip, with_garment: bool) -> None:
    clip = tube_clip if with_garment else replace(tube_clip, garment=None)
    scene = trimesh.load(animated_glb(tmp_path / "tube.glb", clip), process=False)
    assert set(scene.geometry) == ({"body", "garment"} if with_garment else {"body"})
    np.testing.assert_allclose(scene.geometry["body"].vertices, clip.body.vertices[0], atol=1e-6)
