"""What the arrays of a clip must be, told from shapes and types alone: before anything large is read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from render import InputError

INDICES = (
    "garment_faces", "body_faces", "parents", "original_faces", "original_vertices", "uv_faces", "face_materials",
)  # fmt: skip
_ANY = None


def check_arrays(arrays: Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]], source: str) -> None:
    """Raise InputError unless shapes and types of a clip's arrays are of their kind and fit each other.

    Args:
        arrays: shape and type of each array that is there, by the names of `Clip`.
        source: what messages call the clip.
    """

    def length(name: str) -> int | None:
        shape = arrays[name][0] if name in arrays else ()
        return shape[0] if shape else None

    frames, garment, body = length("body_vertices"), length("template_vertices"), length("body_rest")
    wanted: dict[str, tuple[int | None, ...]] = {
        "template_vertices": (_ANY, 3),
        "garment_faces": (_ANY, 3),
        "garment_vertices": (frames, garment, 3),
        "body_rest": (_ANY, 3),
        "body_faces": (_ANY, 3),
        "body_vertices": (_ANY, body, 3),
        "poses": (frames, _ANY, 3),
        "trans": (frames, 3),
        "joints_rest": (_ANY, 3),
        "parents": (_ANY,),
        "blend_weights": (body, _ANY),
        "joint_transforms": (frames, _ANY, 3, 4),
        "original_faces": (_ANY, 3),
        "original_vertices": (_ANY,),
        "uvs": (_ANY, 2),
        "uv_faces": (length("original_faces"), 3),
        "face_materials": (length("original_faces"),),
    }
    for name, (shape, dtype) in arrays.items():
        if dtype.kind not in ("iu" if name in INDICES else "fiu"):
            kind = "integers" if name in INDICES else "numbers"
            raise InputError(f"{source}: {name}: {kind} are wanted, found {dtype}")
        fits = len(shape) == len(wanted[name]) and all(
            want in (None, given) for want, given in zip(wanted[name], shape, strict=True)
        )
        if not fits:
            expected = ", ".join("any" if want is None else str(want) for want in wanted[name])
            raise InputError(f"{source}: {name} must have shape ({expected}), found {shape}")
    if not frames:
        raise InputError(f"{source}: body_vertices has no frames")
    if length("poses") and arrays["poses"][0][1] == 0:
        raise InputError(f"{source}: poses have no joint")
    if length("joints_rest") == 0:
        raise InputError(f"{source}: joints_rest has no joint")


def plain(values: np.ndarray, *, whole: bool) -> np.ndarray:
    """The array in a type that every library here takes: float32 or 64, int32 or 64, in this machine's byte order.

    What is one of these already comes back as it is.

    Args:
        values: numbers that `check_arrays` let through, indices within their range.
        whole: they are indices.
    """
    for kept in (np.int32, np.int64) if whole else (np.float32, np.float64):
        if values.dtype == np.dtype(kept).newbyteorder(values.dtype.byteorder):
            return values.astype(kept, copy=False)
    return values.astype(np.int64 if whole else np.float32)
