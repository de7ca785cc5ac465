"""The garment or the body of a clip as a mesh in motion."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np

from imgtransfer.data.clip import REQUIRED, Clip
from imgtransfer.data.reader import NpzReader, Reader
from render import InputError, Mesh, MeshSequence
from render.files.npz import open_npz
from render.files.sequence import open_arrays

Kind = Literal["body", "garment"]


def open_clip_arrays(path: Path, kind: Kind) -> MeshSequence:
    """A mesh in motion from a clip npz, or from an npz with `<kind>_faces` (G, 3) and `<kind>_vertices` (T, N, 3).

    Raises:
        InputError: no such file, a damaged one, or arrays that are missing or of a wrong shape.
    """
    clip = clip_reader(
        path, f"an npz with {kind}_faces and {kind}_vertices, or mesh files, one a frame, or a point cache,"
    )
    if clip is None:
        return open_arrays(path, f"{kind}_faces", f"{kind}_vertices")
    return sequence_of(clip, kind, str(path))


def clip_reader(path: Path, wanted: str = "a clip npz") -> NpzReader | None:
    """The clip in an npz; None where it holds something else.

    Args:
        wanted: what the message says where there is no npz.

    Raises:
        InputError: no such file, or no npz.
    """
    with open_npz(path, wanted) as npz:
        return NpzReader(path) if set(REQUIRED) - {"garment_vertices"} <= set(npz.names) else None


def sequence_of(clip: Reader, kind: Kind, source: str) -> MeshSequence:
    """The garment or the body of a clip in motion, at rest as the clip has it; `source` is what messages call it.

    Raises:
        InputError: a clip without a garment in motion, or what its reader refuses.
    """
    first = clip.clip(0, 1)
    if kind == "garment" and first.garment is None:
        raise InputError(f"{source}: this clip has no garment_vertices, only a body")

    def parts(count: int) -> Iterator[np.ndarray]:
        return (vertices_of(part, kind) for part in clip.parts(count))

    mesh = (
        first.template_mesh
        if kind == "garment"
        else Mesh(first.body.rest, first.body.faces, f"{source}: body")
    )
    return MeshSequence(mesh, clip.n_frames, parts, source, first.fps)


def vertices_of(clip: Clip, kind: Kind) -> np.ndarray:
    """(T, N, 3) of the garment, which must be there, or of the body."""
    if kind == "body":
        return clip.body.vertices
    assert clip.garment is not None
    return clip.garment.vertices
