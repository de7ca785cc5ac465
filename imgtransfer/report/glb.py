"""A moving clip as one binary glTF 2.0 file: body and garment, each frame a morph target.

Written here because no maintained library writes morph-target animation; the container is a header and two
chunks (glTF 2.0 specification, section 4.4). It opens in Blender, three.js and other viewers.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imgtransfer.data.clip import Clip
from imgtransfer.report.glb_look import Seamed, cut_at_seams, material, mime_type
from render import InputError, Option
from render.files.atomic import written_whole
from render.mesh.normals import vertex_normals
from render.mesh.surface import Surface

_MOST_BYTES = 2**32 - 1  # that a GLB can say of its own length
_FLOAT, _UINT = 5126, 5125  # component types
_VERTICES, _INDICES = 34962, 34963  # buffer targets
COLOURS = {"body": (0.80, 0.66, 0.56, 1.0), "garment": (0.23, 0.42, 0.68, 1.0)}  # linear RGBA


def animated_glb(path: str | Path, clip: Clip, *, step: int = 1) -> Path:
    """Write the clip as an animated GLB; the vertex order of both meshes is kept.

    A garment that knows its file has the order, the texture coordinates, the materials and the textures of that file;
    vertices on texture seams get copies behind all others, as glTF allows one coordinate a vertex only.

    Args:
        path: the file to write, ending in .glb.
        clip: in world coordinates; glTF's axes are ours (y up, +z front, metres). Without garment vertices
            only the body is written.
        step: one morph target every so many frames, between which viewers interpolate.

    Returns:
        The path.

    Raises:
        InputError: more than 4 GiB, which the format cannot hold.
    """
    meshes = {"body": (clip.body.vertices, clip.body.faces)}
    if clip.garment is not None:
        meshes["garment"] = (clip.garment.vertices, clip.template.faces)
    looks = {"garment": clip.template.surface}
    frames = np.arange(0, clip.n_frames, step)
    n_vertices = sum(vertices.shape[1] for vertices, _ in meshes.values())
    # Targets, and the weights of each frame.
    size = len(frames) * (24 * n_vertices + 4 * len(meshes) * len(frames))
    if size > _MOST_BYTES:
        raise InputError(
            f"{path}: {len(frames)} frames of {n_vertices} vertices are {size / 2**30:.1f} GiB, and a GLB holds 4 at "
            f"most; take fewer with {Option('step')}"
        )
    document = _Document()
    for name, (vertices, faces) in meshes.items():
        document.add_mesh(name, vertices[frames], faces, frames / clip.fps, looks.get(name))
    path = Path(path)
    with written_whole(path) as temporary:
        temporary.write_bytes(document.to_bytes())
    return path


class _Document:
    """A glTF document that grows mesh by mesh, with one binary buffer."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "imgtransfer"},
            "scene": 0,
            "scenes": [{"nodes": []}],
            **{key: [] for key in ("nodes", "meshes", "materials", "accessors", "bufferViews")},
        }

    def add_mesh(
        self,
        name: str,
        vertices: np.ndarray,
        faces: np.ndarray,
        times: np.ndarray,
        surface: Surface | None = None,
    ) -> None:
        """Add a mesh (K, N, 3) that moves through its frames at `times` (K,) in seconds, with its look if known."""
        normals = vertex_normals(torch.from_numpy(vertices), torch.from_numpy(faces.astype(np.int64))).numpy()
        normals[(normals == 0).all(-1)] = (0, 1, 0)  # glTF wants unit vectors even where there is no area
        seamed = (
            cut_at_seams(surface)
            if surface is not None
            else Seamed(np.arange(vertices.shape[1]), faces, None)
        )
        vertices, normals = vertices[:, seamed.vertices], normals[:, seamed.vertices]
        attributes = {
            "POSITION": self._add(vertices[0], _VERTICES, bounds=True),
            "NORMAL": self._add(normals[0], _VERTICES),
        }
        if seamed.uvs is not None:
            attributes["TEXCOORD_0"] = self._add(seamed.uvs, _VERTICES)
        targets = [
            {
                "POSITION": self._add(vertices[k] - vertices[0], _VERTICES, bounds=True),
                "NORMAL": self._add(normals[k] - normals[0], _VERTICES),
            }
            for k in range(1, len(vertices))
        ]
        primitives: list[dict[str, Any]] = [
            {"attributes": attributes, "indices": self._add(part.reshape(-1), _INDICES), "material": look}
            | ({"targets": targets} if targets else {})
            for part, look in self._parts(name, seamed.faces, surface)
        ]
        mesh: dict[str, Any] = {"name": name, "primitives": primitives}
        if targets:
            mesh["weights"] = [0.0] * len(targets)
        node = self._append("nodes", {"name": name, "mesh": self._append("meshes", mesh)})
        self.json["scenes"][0]["nodes"].append(node)
        if targets:
            self._animate(node, times)

    def _parts(self, name: str, faces: np.ndarray, surface: Surface | None) -> list[tuple[np.ndarray, int]]:
        """The faces of each material that has any, and its index."""
        if surface is None or surface.face_materials is None:
            return [(faces, self._append("materials", _material(name)))]
        parts = []
        for number, used in enumerate(surface.materials):
            part = faces[surface.face_materials == number]
            if len(part):
                described, image = material(used, surface.mtl, COLOURS[name])
                if image is not None:
                    described["pbrMetallicRoughness"]["baseColorTexture"] = {"index": self._add_image(image)}
                parts.append((part, self._append("materials", described)))
        return parts

    def _add_image(self, path: Path) -> int:
        """Put an image file into the buffer, and return the index of its texture."""
        content = path.read_bytes()
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.binary += content + b"\0" * (-len(content) % 4)  # what follows stays aligned
        image = {"bufferView": self._append("bufferViews", view), "mimeType": mime_type(path)}
        images, textures = self.json.setdefault("images", []), self.json.setdefault("textures", [])
        images.append(image)
        textures.append({"source": len(images) - 1})
        return len(textures) - 1

    def to_bytes(self) -> bytes:
        """The GLB container: header, JSON chunk, binary chunk."""
        text = json.dumps({**self.json, "buffers": [{"byteLength": len(self.binary)}]}, separators=(",", ":"))
        chunks = b""
        for kind, content, filler in ((b"JSON", text.encode(), b" "), (b"BIN\0", bytes(self.binary), b"\0")):
            padded = content + filler * (-len(content) % 4)
            chunks += struct.pack("<I", len(padded)) + kind + padded
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def _animate(self, node: int, times: np.ndarray) -> None:
        """At time k the weight of target k − 1 is 1 and the others are 0; all are 0 at the first."""
        weights = np.eye(len(times), len(times) - 1, k=-1, dtype=np.float32)
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


def _material(name: str) -> dict[str, Any]:
    surface = {"baseColorFactor": list(COLOURS[name]), "metallicFactor": 0.0, "roughnessFactor": 0.85}
    return {"name": name, "pbrMetallicRoughness": surface, "doubleSided": name == "garment"}
