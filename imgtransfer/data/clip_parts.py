"""What a clip is made of, and the names that files and messages have for its arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from render import InputError
from render.mesh.surface import Surface


@dataclass(frozen=True, eq=False)
class Template:
    """The garment in the body's rest pose; `Clip.template_mesh` is the same as a `render.Mesh`, in its types.

    Args:
        vertices: (N, 3) float32. faces: (F, 3) int, counter-clockwise from outside.
        surface: texture coordinates, materials and the numbering of the garment's file; None where nothing is known.
    """

    vertices: np.ndarray
    faces: np.ndarray
    surface: Surface | None = None


@dataclass(frozen=True, eq=False)
class Garment:
    """The template in motion.

    Args:
        vertices: (T, N, 3) float32.
    """

    vertices: np.ndarray


@dataclass(frozen=True, eq=False)
class Body:
    """The body at rest and in motion.

    Args:
        rest: (B, 3) float32, in the template's frame. faces: (G, 3) int. vertices: (T, B, 3) float32.
    """

    rest: np.ndarray
    faces: np.ndarray
    vertices: np.ndarray


@dataclass(frozen=True, eq=False)
class Skeleton:
    """What moves the body, as far as it is known.

    Args:
        poses: (T, J, 3) axis-angle of the SMPL joints, local; joint 0 is the global orientation.
        trans: (T, 3); the root joint is at `joints_rest[0] + trans` (the SMPL convention).
        joints_rest: (J', 3) rest positions; J' may be 1 where only the root is known.
        parents: (J',) int, parent of each joint, -1 for the root.
        blend_weights: (B, K) linear blend skinning weights of the body's vertices.
        joint_transforms: (T, K, 3, 4) rest-to-posed transforms that belong to `blend_weights`; where it is
            None, K = J and they follow from poses, trans, joints_rest and parents.
    """

    poses: np.ndarray | None = None
    trans: np.ndarray | None = None
    joints_rest: np.ndarray | None = None
    parents: np.ndarray | None = None
    blend_weights: np.ndarray | None = None
    joint_transforms: np.ndarray | None = None


# Every array of a clip by its name in npz files, data sets and messages: the part that holds it, and its field there.
FLAT = {
    "template_vertices": ("template", "vertices"),
    "garment_faces": ("template", "faces"),
    "garment_vertices": ("garment", "vertices"),
    "body_rest": ("body", "rest"),
    "body_faces": ("body", "faces"),
    "body_vertices": ("body", "vertices"),
    **{field.name: ("skeleton", field.name) for field in fields(Skeleton)},
    "original_faces": ("surface", "faces"),
    "original_vertices": ("surface", "vertices"),
    "uvs": ("surface", "uvs"),
    "uv_faces": ("surface", "uv_faces"),
    "face_materials": ("surface", "face_materials"),
}
STORED = tuple(FLAT)
SKINNING = tuple(name for name, (part, _) in FLAT.items() if part == "skeleton")
SURFACE = tuple(name for name, (part, _) in FLAT.items() if part == "surface")
PER_FRAME = ("garment_vertices", "body_vertices", "poses", "trans", "joint_transforms")


def flat_arrays(
    template: Template, garment: Garment | None, body: Body, skeleton: Skeleton
) -> dict[str, np.ndarray]:
    """The arrays of a clip's parts by their names in `FLAT`, in that order; those that are None are left out."""
    parts = {
        "template": template,
        "garment": garment,
        "body": body,
        "skeleton": skeleton,
        "surface": template.surface,
    }
    arrays = {name: getattr(parts[part], field, None) for name, (part, field) in FLAT.items()}
    return {name: values for name, values in arrays.items() if values is not None}


def parts_of(
    arrays: Mapping[str, np.ndarray], *, materials: tuple[str, ...] = (), mtl: str = ""
) -> dict[str, Any]:
    """The inverse of `flat_arrays`: template, garment, body and skeleton by these names.

    Args:
        arrays: all that are required, see `imgtransfer.data.clip.REQUIRED`.
        materials, mtl: of the surface.

    Raises:
        InputError: arrays of a surface that do not fit each other.
    """
    by_part: dict[str, dict[str, Any]] = {}
    for name, values in arrays.items():
        part, field = FLAT[name]
        by_part.setdefault(part, {})[field] = values
    look = by_part.get("surface")
    if look is not None and not {"faces", "vertices"} <= look.keys():
        raise InputError("original_faces and original_vertices come together, and all of a look with them")
    surface = None if look is None else Surface(**look, materials=materials, mtl=mtl)
    return {
        "template": Template(**by_part["template"], surface=surface),
        "garment": Garment(**by_part["garment"]) if "garment" in by_part else None,
        "body": Body(**by_part["body"]),
        "skeleton": Skeleton(**by_part.get("skeleton", {})),
    }
