"""Wavefront OBJ: its own vertex order, texture coordinates and materials.

Read here, because trimesh reorders, splits and drops vertices. Facts of the format: Wavefront, "Object Files (.obj)",
appendix B of the Advanced Visualizer manual.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from render.errors import InputError
from render.files.mtl import in_library, library_text
from render.files.obj_numbers import LARGEST_INDEX, Corners, columns, corners, fans, gathered
from render.files.text_lines import as_text, plain_lines
from render.mesh.surface import Surface

_LARGEST_UV = 1e6  # repetitions of a texture
_LINES_AT_ONCE = 200_000
_GEOMETRY_NOT_READ = (b"call", b"surf", b"bzp", b"bsp")  # another file; free-form surfaces; patches
_SPACE, _TAB, _NEWLINE, _HASH = 32, 9, 10, 35


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, Surface | None]:
    """Read an OBJ file; polygons become fans, vertices that no face uses stay, loose points and lines are passed over.

    Args:
        path: the file; material libraries and textures are looked for beside it.

    Returns:
        Vertices (N, 3) float64, faces (F, 3) int64, and the surface where the file has texture coordinates or
        materials. Indices out of range are not checked here.

    Raises:
        InputError: a line that is no valid vertex, texture coordinate or face, texture indices out of range, or
            geometry of a kind that is not read (free-form surfaces, other files called).
    """
    lines = _Lines.of(path, plain_lines(path.read_bytes()))
    vertices = lines.table("v", "vertex or face", wanted=3, least=3)
    uvs = lines.table("vt", "texture coordinate", wanted=2, least=1)
    polygons = lines.polygons()
    places, polygon = fans(polygons.counts)
    line = lines.faces[polygon][:, None]
    faces = _counted(polygons.vertices[places], np.searchsorted(lines.vertices, line))
    looks = lines.looks()
    if not len(faces) or faces.min() < 0 or faces.max() >= len(vertices):
        return vertices, faces, None
    uv_faces = _uv_faces(path, polygons.uvs[places], np.searchsorted(lines.coordinates, line), len(uvs))
    surface = Surface(faces, np.arange(len(vertices)))
    if (uv_faces >= 0).any():
        surface = replace(surface, uvs=uvs.astype(np.float32), uv_faces=uv_faces)
    if looks.names:
        surface = _with_materials(surface, looks, lines.faces[polygon], path.parent)
    return vertices, faces, surface if surface.has_look else None


@dataclass(frozen=True)
class _Looks:
    """Materials as the file names them.

    Args:
        lines, names: of every `usemtl`. libraries: of every `mtllib`, each once.
    """

    lines: list[int]
    names: list[str]
    libraries: list[bytes]


@dataclass(eq=False)
class _Lines:
    """The lines of a file by what they say; each kind's numbers count all lines.

    Args:
        buffer: (B,) uint8, ended by a line feed; keywords and comments of numbers' lines are blank.
        starts, ends: (L,) of all lines.
        vertices, coordinates, faces, others: line numbers.
    """

    path: Path
    buffer: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    vertices: np.ndarray
    coordinates: np.ndarray
    faces: np.ndarray
    others: np.ndarray

    @classmethod
    def of(cls, path: Path, content: bytes) -> _Lines:
        buffer = np.frombuffer(content + b"\n\n\n\n", np.uint8).copy()
        ends = np.flatnonzero(buffer == _NEWLINE)
        starts = np.append(0, ends[:-1] + 1)
        first = starts.copy()
        blank = np.flatnonzero(_is_blank(buffer[first]))
        while len(blank):
            first[blank] += 1
            blank = blank[_is_blank(buffer[first[blank]])]
        a, b = buffer[first], buffer[np.minimum(first + 1, len(buffer) - 1)]
        c = buffer[np.minimum(first + 2, len(buffer) - 1)]
        b_ends, c_ends = _is_blank(b) | (b == _NEWLINE), _is_blank(c) | (c == _NEWLINE)
        vertex = (a == ord("v")) & b_ends
        coordinate = (a == ord("v")) & (b == ord("t")) & c_ends
        long_face = (
            (a == ord("f")) & (b == ord("o")) & c_ends
        )  # what faces were in the format's first version
        face = ((a == ord("f")) & b_ends) | long_face
        other = np.isin(a, np.frombuffer(b"umcsb", np.uint8)) & ~b_ends
        buffer[first[vertex | coordinate | face]] = _SPACE
        buffer[first[coordinate | long_face] + 1] = _SPACE
        lines = cls(
            path, buffer, starts, ends, *(np.flatnonzero(kind) for kind in (vertex, coordinate, face, other))
        )
        lines._blank_comments(vertex | coordinate | face)
        return lines

    def _blank_comments(self, of_numbers: np.ndarray) -> None:
        marks = np.flatnonzero(self.buffer == _HASH)
        line = np.searchsorted(self.ends, marks)
        for mark, end in zip(
            *(part[of_numbers[line]].tolist() for part in (marks, self.ends[line])), strict=True
        ):
            self.buffer[mark:end] = _SPACE

    def text(self, line: int) -> bytes:
        return self.buffer[self.starts[line] : self.ends[line]].tobytes()

    def table(self, keyword: str, what: str, *, wanted: int, least: int) -> np.ndarray:
        """(L, wanted) float64 of the lines with vertices ("v") or texture coordinates ("vt")."""

        def of_line(words: list[bytes]) -> list[float]:
            numbers = [float(word) for word in words[:wanted]]
            if len(numbers) < least:
                raise ValueError
            return numbers + [0.0] * (wanted - len(numbers))

        parts = [np.zeros((0, wanted))]
        for lines in _chunks(self.vertices if keyword == "v" else self.coordinates):
            try:
                part = columns(gathered(self.buffer, self.starts[lines], self.ends[lines]), wanted, least)
            except ValueError:
                part = np.array(self._one_by_one(lines, what, of_line))
            if keyword == "vt" and not (np.abs(part) <= _LARGEST_UV).all():
                self._refuse(lines[np.argmax(~(np.abs(part) <= _LARGEST_UV).all(axis=1))], what)
            parts.append(part)
        return np.concatenate(parts)

    def polygons(self) -> Corners:
        """The corners of all faces."""
        parts = []
        for lines in _chunks(self.faces):
            try:
                parts.append(corners(gathered(self.buffer, self.starts[lines], self.ends[lines])))
            except ValueError:
                rows = self._one_by_one(lines, "vertex or face", _corners_of_line)
                vertices, uvs = np.array([corner for row in rows for corner in row], np.int64).T
                parts.append(Corners(np.array([len(row) for row in rows]), vertices, uvs))
        if not parts:
            return Corners(*(np.zeros(0, np.int64),) * 3)
        names = ("counts", "vertices", "uvs")
        return Corners(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def _one_by_one(
        self, lines: np.ndarray, what: str, read: Callable[[list[bytes]], list[float] | list[tuple[int, int]]]
    ) -> list[list[float] | list[tuple[int, int]]]:
        """What is read of each line by a reader that forgives more than the fast one; refuses the first bad line."""
        results = []
        for line in lines.tolist():
            try:
                results.append(read(self.text(line).split()))
            except ValueError:
                self._refuse(line, what)
        return results

    def _refuse(self, line: int, what: str) -> NoReturn:
        number, text = self._original(line)
        raise InputError(f"{self.path}: line {number} is not a valid {what}: '{text}'")

    def _original(self, line: int) -> tuple[int, str]:
        """The number of a line in the file, where continued lines are several, and its text."""
        content, start = plain_lines(self.path.read_bytes(), joined=False), int(self.starts[line])
        text = content[start:].split(b"\n", 1)[0]
        return content.count(b"\n", 0, start) + 1, as_text(text.strip()[:80])

    def looks(self) -> _Looks:
        """What is said of materials; refuses geometry of a kind that is not read."""
        looks = _Looks([], [], [])
        for line in self.others.tolist():
            keyword, _, rest = self.text(line).strip().replace(b"\t", b" ").partition(b" ")
            if keyword == b"usemtl":
                looks.lines.append(line)
                looks.names.append(as_text(rest.strip()) or "material")
            elif keyword == b"mtllib":
                looks.libraries.append(rest.strip())
            elif keyword in _GEOMETRY_NOT_READ:
                number, text = self._original(line)
                raise InputError(
                    f"{self.path}: line {number} '{text}' is no polygon of this file (a free-form surface, a patch or "
                    "another file), which is not read; export polygons into one file"
                )
        return looks


def _chunks(lines: np.ndarray) -> Iterator[np.ndarray]:
    return (lines[start : start + _LINES_AT_ONCE] for start in range(0, len(lines), _LINES_AT_ONCE))


def _is_blank(byte: np.ndarray) -> np.ndarray:
    return np.asarray((byte == _SPACE) | (byte == _TAB))


def _corners_of_line(words: list[bytes]) -> list[tuple[int, int]]:
    parts = [word.split(b"/") for word in words]
    corners = [(int(part[0]), int(part[1]) if len(part) > 1 and part[1] else 0) for part in parts]
    if len(corners) < 3 or max(abs(index) for corner in corners for index in corner) > LARGEST_INDEX:
        raise ValueError
    return corners


def _counted(indices: np.ndarray, before: np.ndarray) -> np.ndarray:
    """From 0: OBJ counts from 1, and from -1 backwards from the latest; 0 stays invalid (-1)."""
    return np.where(indices >= 0, indices - 1, before + indices)


def _uv_faces(path: Path, written: np.ndarray, before: np.ndarray, count: int) -> np.ndarray:
    """(F, 3) from 0, -1 in faces of which a corner has no texture coordinate."""
    lacking = (written == 0).any(axis=1, keepdims=True)
    wrong = ((written > count) | (written < -before)) & ~lacking
    if wrong.any():
        worst = written[wrong][np.argmax(np.abs(written[wrong]))]
        raise InputError(f"{path}: faces use texture coordinate {worst}, but only 1..{count} exist")
    return np.where(lacking, -1, _counted(written, before))


def _with_materials(surface: Surface, looks: _Looks, lines: np.ndarray, folder: Path) -> Surface:
    """The surface with the material in force at the line (F,) of each face, and the libraries' text."""
    mtl = library_text(folder, looks.libraries)
    names = in_library(looks.names, mtl)
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    of_use = np.array([-1, *(numbers[name] for name in names)])
    used = of_use[np.searchsorted(np.array(looks.lines), lines)]
    if (used < 0).any():  # faces before the first usemtl
        used[used < 0] = numbers.setdefault("default", len(numbers))
    return replace(surface, face_materials=used, materials=tuple(numbers), mtl=mtl)
