"""Any mesh in any legal form of OBJ, PLY and GLB is read back: vertices, order, faces, corner coordinates, materials.

Hypothesis draws the mesh and the form; a plain writer here, which shares nothing with the readers, writes it.
"""

from __future__ import annotations

import json
import struct
import tempfile
from dataclasses import dataclass
from itertools import pairwise, zip_longest
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from render import Mesh, load_mesh

QUICK = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
MANY = settings(max_examples=1000, deadline=None, suppress_health_check=list(HealthCheck))
NAMES = st.text(
    st.characters(codec="utf-8", exclude_categories=["C", "Z"], exclude_characters="#\\"), min_size=1
)


@dataclass
class Drawn:
    """A mesh of polygons: places, corners by face, texture coordinates, their numbers by face (None: a face without
    any), and a material's number by face, -1 before the first."""

    places: list[list[float]]
    polygons: list[list[int]]
    uvs: list[list[float]]
    uv_polygons: list[list[int] | None]
    materials: list[str]
    used: list[int]

    def triangles(self) -> list[tuple[int, int, int, int]]:
        """Face, and three corners of it."""
        return [(n, 0, k, k + 1) for n, face in enumerate(self.polygons) for k in range(1, len(face) - 1)]

    def faces(self) -> list[list[int]]:
        return [[self.polygons[n][k] for k in corners] for n, *corners in self.triangles()]

    def corner_uvs(self) -> list[list[list[float]] | None]:
        rows = []
        for n, *corners in self.triangles():
            numbers = self.uv_polygons[n]
            rows.append(None if numbers is None else [self.uvs[numbers[k]] for k in corners])
        return rows


FLOATS = st.floats(-1e6, 1e6, width=32)


@st.composite
def meshes(draw: st.DrawFn, *, largest: int = 6) -> Drawn:
    places = draw(st.lists(st.lists(FLOATS, min_size=3, max_size=3), min_size=1, max_size=9))
    corner = st.integers(0, len(places) - 1)
    polygons = draw(st.lists(st.lists(corner, min_size=3, max_size=largest), min_size=1, max_size=6))
    uvs = draw(st.lists(st.lists(st.floats(-8, 8, width=32), min_size=2, max_size=2), max_size=7))
    uv_polygons = [
        draw(st.lists(st.integers(0, len(uvs) - 1), min_size=len(face), max_size=len(face)))
        if uvs and draw(st.booleans())
        else None
        for face in polygons
    ]
    materials = draw(st.lists(NAMES, max_size=3, unique=True))
    used = [draw(st.integers(-1, len(materials) - 1)) for _ in polygons]
    return Drawn(places, polygons, uvs, uv_polygons, materials, used)


def check(mesh: Mesh, drawn: Drawn, *, materials: bool) -> None:
    np.testing.assert_array_equal(mesh.vertices, drawn.places)
    assert mesh.faces.tolist() == drawn.faces()
    wanted, surface = drawn.corner_uvs(), mesh.surface
    if surface is None or surface.uvs is None:
        assert wanted == [None] * len(wanted)
    else:
        for row, uvs in zip(surface.uv_faces, wanted, strict=True):
            assert (row < 0).all() if uvs is None else surface.uvs[row].tolist() == np.float32(uvs).tolist()
    names = [
        drawn.materials[drawn.used[n]] if drawn.used[n] >= 0 else "default" for n, *_ in drawn.triangles()
    ]
    if materials and any(number >= 0 for number in drawn.used):
        assert [surface.materials[number] for number in surface.face_materials] == names


def read(content: bytes, name: str) -> Mesh:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / name).write_bytes(content)
        return load_mesh(Path(folder) / name)


def obj(draw: st.DrawFn, mesh: Drawn) -> bytes:
    """A file of the mesh: statements in an order that the format allows, in any of its forms."""
    blank = st.sampled_from([" ", "  ", "\t", " \\\n ", "\\\n\t"])
    end, relative = draw(st.sampled_from(["\n", "\r\n", "\r"])), draw(st.booleans())
    extra = draw(st.sampled_from(["", " 1", " 0.5 0.25 1", " 1 0.5 0.25 1"]))
    noise = st.sampled_from(
        ["", "", "# v 1 2 3", "vn 0 0 1", "g a b", "o part", "s off", "p 1", "l 1 1", "vp 1", "  "]
    )

    def line(*words: str) -> str:
        return draw(st.sampled_from(["", " "])) + words[0] + "".join(draw(blank) + word for word in words[1:])

    def index(number: int, count: int) -> str:
        return str(number - count) if relative and draw(st.booleans()) else str(number + 1)

    head = [line("v", *(repr(value) for value in place)) + extra for place in mesh.places]
    head += [line("vt", *(repr(value) for value in uv)) for uv in mesh.uvs]
    if not relative and draw(st.booleans()):  # the two kinds in turn
        head = [
            row
            for pair in zip_longest(head[: len(mesh.places)], head[len(mesh.places) :])
            for row in pair
            if row
        ]
    faces, current = [], -1
    for number, (face, uvs) in enumerate(zip(mesh.polygons, mesh.uv_polygons, strict=True)):
        used = mesh.used[number]
        if used != current and used >= 0:
            faces.append(f"usemtl {mesh.materials[used]}")
            current = used
        mesh.used[number] = current
        normal = draw(st.sampled_from(["", "1"]))
        words = []
        for k, vertex in enumerate(face):
            word = index(vertex, len(mesh.places))
            word += f"/{index(uvs[k], len(mesh.uvs))}" if uvs else "/" if normal else ""
            words.append(word + (f"/{normal}" if normal else ""))
        faces.append(line("f", *words))
    statements = [*faces, *head] if not relative and draw(st.booleans()) else [*head, *faces]
    lines = [text for statement in statements for text in (draw(noise), statement)]
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return (mark + "\n".join(lines) + draw(st.sampled_from(["", "\n", "\n\x1a"]))).replace("\n", end).encode()


def ply(draw: st.DrawFn, mesh: Drawn) -> bytes:
    """A file of the mesh, with its coordinates at corners, other properties between, other elements around."""
    order = draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]))
    sign = ">" if "big" in order else "<"
    with_uvs = any(mesh.uv_polygons)
    codes = {
        "char": "b",
        "uchar": "B",
        "short": "h",
        "ushort": "H",
        "int": "i",
        "uint": "I",
        "float": "f",
        "double": "d",
    }
    codes |= {"uint8": "B", "int16": "h", "int32": "i", "float32": "f", "float64": "d"}

    def number(kind: str, value: float) -> bytes:
        if order == "ascii":
            return f"{value!r} ".encode()
        return struct.pack(sign + codes[kind], value)

    def listed(kinds: tuple[str, str], values: list) -> bytes:
        return number(kinds[0], len(values)) + b"".join(number(kinds[1], value) for value in values)

    floats = draw(st.sampled_from(["float", "double", "float32", "float64"]))
    count = draw(st.sampled_from(["uchar", "int", "uint8", "ushort", "char"]))
    kind = draw(st.sampled_from(["int", "uint", "short", "int32", "uchar"]))
    columns = draw(
        st.permutations([("x", 0), ("y", 1), ("z", 2), *draw(st.sampled_from([[], [("nx", 3), ("red", 4)]]))])
    )
    types = {"red": "uchar"}
    properties = [("vertex_indices", (count, kind))]
    properties += [("texcoord", ("uchar", "float"))] if with_uvs else []
    properties += draw(st.sampled_from([[], [("flags", "int"), ("near", ("int", "double"))]]))
    properties = draw(st.permutations(properties))
    edges = draw(st.booleans())
    head = ["ply", f"format {order} 1.0", "comment made here", "obj_info end_header"]
    vertex = [f"element vertex {len(mesh.places)}"]
    vertex += [f"property {types.get(name, floats)} {name}" for name, _ in columns]
    face = [f"element face {len(mesh.polygons)}"]
    face += [
        f"property {kinds if isinstance(kinds, str) else 'list ' + ' '.join(kinds)} {name}"
        for name, kinds in properties
    ]
    body = {"vertex": b"", "face": b"", "edge": b"".join(number("int", n) for n in (0, 0))}
    for place in mesh.places:
        values = [*place, 0.5, 200]
        body["vertex"] += b"".join(number(types.get(name, floats), values[at]) for name, at in columns)
        body["vertex"] += b"\n" if order == "ascii" else b""
    for n, polygon in enumerate(mesh.polygons):
        uvs = mesh.uv_polygons[n]
        values = {
            "vertex_indices": polygon,
            "texcoord": [value for at in uvs for value in mesh.uvs[at]] if uvs else [],
            "near": [0.5] * (n % 3),
        }
        for name, kinds in properties:
            body["face"] += number(kinds, n) if isinstance(kinds, str) else listed(kinds, values[name])
        body["face"] += b"\n" if order == "ascii" else b""
    heads = {
        "vertex": vertex,
        "face": face,
        "edge": ["element edge 1", "property int vertex1", "property int vertex2"],
    }
    elements = draw(st.permutations(["vertex", "face", *(["edge"] if edges else [])]))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = end.join([*head, *(row for name in elements for row in heads[name]), "end_header", ""])
    return text.encode() + b"".join(body[name] for name in elements)


def glb(draw: st.DrawFn, mesh: Drawn) -> bytes:
    """A file of the mesh: a primitive for each run of faces of one material, all with the same vertices."""
    binary, views, accessors = bytearray(), [], []

    def add(values: np.ndarray, component: int, kind: str, *, gap: int = 0, **more: object) -> int:
        while len(binary) % 4:
            binary.append(0)
        rows = np.ascontiguousarray(values).reshape(len(values), -1)
        view = {"buffer": 0, "byteOffset": len(binary)}
        size = rows.dtype.itemsize * rows.shape[1]
        if gap:  # interleaved with something else
            view["byteStride"] = size + gap
        stored = b"".join(row.tobytes() + b"\xff" * gap for row in rows)
        binary.extend(b"\x7f" * 4 + stored)
        views.append(view | {"byteLength": len(stored) + 4})
        accessors.append({"bufferView": len(views) - 1, "byteOffset": 4, "componentType": component,
                          "count": len(values), "type": kind} | more)  # fmt: skip
        return len(accessors) - 1

    shift, scale = [1.0, 2.0, -4.0], 2.0
    places = (np.array(mesh.places, np.float32) - np.float32(shift)) / np.float32(scale)
    mesh.places = (places.astype(np.float64) * scale + shift).tolist()
    position = add(places, 5126, "VEC3", gap=draw(st.sampled_from([0, 8])))
    coordinates = None
    if any(mesh.uv_polygons):  # one a vertex
        uvs = np.array([mesh.uvs[n % len(mesh.uvs)] for n in range(len(places))], np.float32)
        if draw(st.booleans()):
            whole = np.arange(2 * len(uvs)).reshape(-1, 2) * 37 % 256
            coordinates, uvs = add(np.pad(whole, ((0, 0), (0, 2))).astype(np.uint8)[:, :2], 5121, "VEC2", gap=2, normalized=True), whole / 255  # fmt: skip # noqa: E501
        else:
            coordinates = add(uvs, 5126, "VEC2")
        mesh.uvs = np.stack([uvs[:, 0], 1.0 - uvs[:, 1].astype(np.float64)], -1).astype(np.float32).tolist()
        mesh.uv_polygons = list(mesh.polygons)
    width, component = draw(st.sampled_from([(np.uint8, 5121), (np.uint16, 5123), (np.uint32, 5125)]))
    primitives, runs = (
        [],
        [0, *(n for n in range(1, len(mesh.used)) if mesh.used[n] != mesh.used[n - 1]), len(mesh.used)],
    )
    for start, stop in pairwise(runs):
        indices = np.array(mesh.polygons[start:stop]).reshape(-1).astype(width)
        attributes = {"POSITION": position} | ({} if coordinates is None else {"TEXCOORD_0": coordinates})
        primitive = {"attributes": attributes, "indices": add(indices, component, "SCALAR")}
        primitives.append(primitive | ({"material": mesh.used[start]} if mesh.used[start] >= 0 else {}))
    header = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [1]}],
        "nodes": [
            {"mesh": 0, "scale": [scale] * 3},
            {"children": [0], "translation": shift},
            {"mesh": 0},  # in no scene
        ],
        "meshes": [{"primitives": primitives}],
        "materials": [{"name": name} for name in mesh.materials] or [{}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(header, ensure_ascii=draw(st.booleans())).encode()
    text += b" " * (-len(text) % 4)
    binary.extend(bytes(-len(binary) % 4))
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@st.composite
def files(draw: st.DrawFn, kind: str) -> tuple[Drawn, bytes]:
    mesh = draw(meshes(largest=3 if kind == "glb" else 6))
    return mesh, {"obj": obj, "ply": ply, "glb": glb}[kind](draw, mesh)


def check_file(drawn: tuple[Drawn, bytes], kind: str) -> None:
    mesh, content = drawn
    check(read(content, f"a.{kind}"), mesh, materials=kind != "ply")


@QUICK
@given(files("obj"))
def test_any_obj(drawn):
    check_file(drawn, "obj")


@QUICK
@given(files("ply"))
def test_any_ply(drawn):
    check_file(drawn, "ply")


@QUICK
@given(files("glb"))
def test_any_glb(drawn):
    check_file(drawn, "glb")


@pytest.mark.long
@pytest.mark.parametrize("kind", ["obj", "ply", "glb"])
def test_very_many(kind):
    MANY(given(files(kind))(lambda drawn: check_file(drawn, kind)))()
