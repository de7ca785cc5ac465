"""A moving clip as one binary glTF 2.0 file: body and garment, each frame a morph target.

Written here because no maintained library writes morph-target animation; the container is a header and two
chunks (glTF 2.0 specification, section 4.4). It opens in Blender, three.js and other viewers.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.exports.materials import IMAGES, Material, parts_of
from imgtransfer.exports.objects import COLOURS, MovingObject, objects_of
from imgtransfer.exports.seams import Seamed, cut_at_seams
from render import InputError, Option
from render.files.atomic import written_whole
from render.mesh.normals import vertex_normals

_MOST_BYTES = 2**32 - 1  # that a GLB can say of its own length
_FLOAT, _UINT = 5126, 5125  # component types
_VERTICES, _INDICES = 34962, 34963  # buffer targets


@contextmanager
def written_glb(path: Path, *, n_frames: int, step: int = 1) -> Iterator[Callable[[Clip], None]]:
    """Yield what takes the frames of a clip, some at a time; the GLB appears whole when the block ends without error.

    A garment that knows its file has the order, the texture coordinates, the materials and the textures of that file;
    vertices on texture seams get copies behind all others, as glTF allows one coordinate a vertex only. What the file
    will hold is in memory until then: all that a GLB says of its buffer stands before it.

    Args:
        path: the file to write, ending in .glb.
        n_frames: that will come, T. step: what their numbers in the clip count by: frame k is shown at k · step / fps.

    Raises:
        InputError: more than 4 GiB, which the format cannot hold.
    """
    document: _Document | None = None

    def add(part: Clip) -> None:
        nonlocal document
        objects = objects_of(part)
        if document is None:
            _check_size(path, n_frames, objects)
            document = _Document(np.arange(n_frames) * (step / part.fps))
        for thing in objects:
            document.add(thing, thing.moved(part))

    with written_whole(path) as temporary:
        yield add
        assert document is not None  # every clip has frames
        temporary.write_bytes(document.to_bytes())


def animated_glb(path: str | Path, clip: Clip) -> Path:
    """Write a clip that is in memory; see `written_glb`. glTF's axes are ours (y up, +z front, metres)."""
    with written_glb(Path(path), n_frames=clip.n_frames) as add:
        add(clip)
    return Path(path)


def _check_size(path: Path, n_frames: int, objects: list[MovingObject]) -> None:
    n_vertices = sum(len(thing.rest.vertices) for thing in objects)
    # Targets, and the weights of each frame.
    size = n_frames * (24 * n_vertices + 4 * len(objects) * n_frames)
    if size > _MOST_BYTES:
        raise InputError(
            f"{path}: {n_frames} frames of {n_vertices} vertices are {size / 2**30:.1f} GiB, and a GLB holds 4 at "
            f"most; take fewer with {Option('step')}, or write .usd or .abc"
        )


class _Document:
    """A glTF document that grows frame by frame, with one binary buffer.

    Args:
        times: (T,) seconds at which the frames are shown.
    """

    def __init__(self, times: np.ndarray) -> None:
        self.times = times
        self.binary = bytearray()
        self.first: dict[
            str, tuple[np.ndarray, np.ndarray]
        ] = {}  # vertices and normals of each object at first
        self.seamed: dict[str, Seamed] = {}
        self.targets: dict[str, list[dict[str, int]]] = {}
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "imgtransfer"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{key: [] for key in ("nodes", "meshes", "materials", "accessors", "bufferViews")},
        }

    def add(self, thing: MovingObject, vertices: np.ndarray) -> None:
        """Add the next frames (t, N, 3) of an object; the first of all is the mesh, the others are targets."""
        faces = torch.from_numpy(np.asarray(thing.rest.faces, np.int64))
        normals = vertex_normals(torch.from_numpy(vertices), faces).numpy()
        normals[(normals == 0).all(-1)] = (0, 1, 0)  # glTF wants unit vectors even where there is no area
        if thing.name not in self.seamed:
            self.seamed[thing.name] = cut_at_seams(thing.surface)
        used = self.seamed[thing.name].vertices
        frames = list(zip(vertices[:, used], normals[:, used], strict=True))
        if thing.name not in self.first:
            self.first[thing.name] = frames.pop(0)
            self._add_mesh(thing, *self.first[thing.name])
        at_first, normals_at_first = self.first[thing.name]
        self.targets[thing.name] += [
            {
                "POSITION": self._add(moved - at_first, _VERTICES, bounds=True),
                "NORMAL": self._add(turned - normals_at_first, _VERTICES),
            }
            for moved, turned in frames
        ]

    def _add_mesh(self, thing: MovingObject, vertices: np.ndarray, normals: np.ndarray) -> None:
        seamed = self.seamed[thing.name]
        attributes = {
            "POSITION": self._add(vertices, _VERTICES, bounds=True),
            "NORMAL": self._add(normals, _VERTICES),
        }
        if seamed.uvs is not None:
            attributes["TEXCOORD_0"] = self._add(seamed.uvs, _VERTICES)
        primitives: list[dict[str, Any]] = [
            {
                "attributes": attributes,
                "indices": self._add(seamed.faces[numbers].reshape(-1), _INDICES),
                "material": self._add_material(thing.name, material),
            }
            for material, numbers in parts_of(thing.name, thing.surface)
        ]
        mesh: dict[str, Any] = {"name": thing.name, "primitives": primitives}
        node = self._append("nodes", {"name": thing.name, "mesh": self._append("meshes", mesh)})
        self.json["scenes"][0]["nodes"].append(node)
        self.targets[thing.name] = []

    def _add_material(self, name: str, material: Material) -> int:
        described = gltf_material(material, COLOURS[name], both_sides=name == "garment")
        if material.image is not None:
            described["pbrMetallicRoughness"]["baseColorTexture"] = {"index": self._add_image(material.image)}
        return self._append("materials", described)

    def _add_image(self, path: Path) -> int:
        """Put an image file into the buffer, and return the index of its texture."""
        content = path.read_bytes()
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.binary += content + b"\0" * (-len(content) % 4)  # what follows stays aligned
        image = {"bufferView": self._append("bufferViews", view), "mimeType": IMAGES[path.suffix.lower()]}
        images, textures = self.json.setdefault("images", []), self.json.setdefault("textures", [])
        images.append(image)
        textures.append({"source": len(images) - 1})
        return len(textures) - 1

    def to_bytes(self) -> bytes:
        """The GLB container: header, JSON chunk, binary chunk."""
        for node, mesh in enumerate(self.json["meshes"]):
            self._animate(node, mesh, self.targets[mesh["name"]])
        text = json.dumps({**self.json, "buffers": [{"byteLength": len(self.binary)}]}, separators=(",", ":"))
        chunks = b""
        for kind, content, filler in ((b"JSON", text.encode(), b" "), (b"BIN\0", bytes(self.binary), b"\0")):
            padded = content + filler * (-len(content) % 4)
            chunks += struct.pack("<I", len(padded)) + kind + padded
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def _animate(self, node: int, mesh: dict[str, Any], targets: list[dict[str, int]]) -> None:
        """At time k the weight of target k − 1 is 1 and the others are 0; all are 0 at the first."""
        if not targets:
            return
        for primitive in mesh["primitives"]:
            primitive["targets"] = targets
        mesh["weights"] = [0.0] * len(targets)
        times = self.times[: len(targets) + 1]
        weights = np.eye(len(times), len(targets), k=-1, dtype=np.float32)
        animations = self.json.setdefault("animations", [{"name": "clip", "samplers": [], "channels": []}])
        samplers, channels = animations[0]["samplers"], animations[0]["channels"]
        samplers.append(
            {
                "input": self._add(times.astype(np.float32), None, bounds=True),
                "output": self._add(weights.reshape(-1), None),
                "interpolation": "LINEAR",
            }
        )
        channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": "weights"}})

    def _add(self, values: np.ndarray, target: int | None, *, bounds: bool = False) -> int:
        """Append values (n,), (n, 2) or (n, 3) to the buffer, and return the index of their accessor."""
        whole = np.issubdtype(values.dtype, np.integer)
        stored = np.ascontiguousarray(values, "<u4" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": stored.nbytes}
        self.binary += stored.tobytes()  # four-byte numbers, so every offset is aligned
        accessor: dict[str, Any] = {
            "bufferView": self._append("bufferViews", view if target is None else {**view, "target": target}),
            "componentType": _UINT if whole else _FLOAT,
            "count": len(stored),
            "type": "SCALAR" if stored.ndim == 1 else f"VEC{stored.shape[1]}",
        }
        if bounds:
            for key, value in (("min", stored.min(axis=0)), ("max", stored.max(axis=0))):
                accessor[key] = np.atleast_1d(value).astype(float).tolist()
        return self._append("accessors", accessor)

    def _append(self, key: str, entry: dict[str, Any]) -> int:
        self.json[key].append(entry)
        return len(self.json[key]) - 1


def gltf_material(
    material: Material, default: tuple[float, ...], *, both_sides: bool = True
) -> dict[str, Any]:
    """The glTF material without its image; `default` is the linear RGBA of one that nothing describes."""
    if material.image is not None:
        colour = [1.0, 1.0, 1.0, material.opacity]  # multiplies the image
    else:
        colour = list(default) if material.colour is None else [*material.colour, material.opacity]
    surface = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.85}
    described: dict[str, Any] = {
        "name": material.name,
        "pbrMetallicRoughness": surface,
        "doubleSided": both_sides,
    }
    if material.opacity < 1:
        described["alphaMode"] = "BLEND"
    return described
