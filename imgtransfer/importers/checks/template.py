"""A user's own garment mesh, ready to be put on a body: placed, checked and welded."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.findings import refuse
from imgtransfer.importers.checks.meshes import check_template
from imgtransfer.importers.checks.weld import weld
from render import InputError, Mesh, Option
from render.files.sequence import check_choice, load_file
from render.mesh.measures import face_areas
from render.mesh.surface import plain_surface

_FLAT = 0.5e-12  # m², the area of a triangle with sides of a micrometre


def load_template(
    path: str | Path,
    body: Mesh,
    *,
    axes: Axes | None = None,
    body_axes: Axes | None = None,
    chosen: str | None = None,
    welding: bool = False,
    anyway: bool = False,
) -> tuple[Mesh, list[str]]:
    """Read a garment and check it against the body that shall wear it.

    Args:
        path: OBJ, PLY, GLB, STL, Alembic or USD.
        body: in its rest pose, metres, y up, facing +z; its `source` is what messages call it.
        axes: how the file lies; None for metres, y up, facing +z.
        body_axes: how the body's file lay, where it came from one.
        chosen: which mesh of an Alembic or USD file, by name or path; None takes the only one.
        welding: join split seams.
        anyway: take it although the checks found something.

    Returns:
        The garment in metres, y up, facing +z, with texture coordinates, materials and the file's numbering in its
        `surface`; and what is odd about it but no obstacle, one text each, for the user to read.

    Raises:
        InputError: a file that cannot be read, severe findings (the message names the settings that mend them), or
            vertices and triangles that cannot be cloth.
    """
    axes = axes or Axes()
    which = Option("garment_object", chosen)
    path = Path(path)
    check_choice(which, path)
    loaded = load_file(path, which)
    garment, lay = axes.of_mesh(loaded), axes.of_file(loaded.axes)
    faults = check_template(garment, body, given=body_axes, garment_given=lay, welding=welding)
    notes = refuse(faults, anyway=anyway)
    mesh = _cloth_of(weld(garment).mesh if welding else garment)
    _check_cloth(mesh)
    return mesh, notes


def _cloth_of(mesh: Mesh) -> Mesh:
    """The mesh without vertices that belong to no triangle and would have no mass.

    In the file's numbering, which `surface` keeps, each of them goes with the vertex that is nearest to it.
    """
    used = np.unique(mesh.faces)
    if len(used) == len(mesh.vertices):
        return mesh
    number = cKDTree(mesh.vertices[used]).query(mesh.vertices)[1]
    number[used] = np.arange(len(used))  # also where two are at one place
    surface = mesh.surface or plain_surface(mesh.faces, len(mesh.vertices))
    of_file = replace(surface, vertices=number[surface.vertices])
    return Mesh(mesh.vertices[used], number[mesh.faces], mesh.source, of_file)


def _check_cloth(mesh: Mesh) -> None:
    """Raise InputError where a part of the mesh can be imported, but cannot be simulated: it would have no mass."""
    flat = face_areas(mesh.vertices, mesh.faces) < _FLAT
    if flat.any():
        raise InputError(
            f"{mesh.source}: {flat.sum()} triangles have no area (triangle {int(np.argmax(flat))} first, vertices "
            f"{mesh.faces[np.argmax(flat)].tolist()}), and cannot be cloth; merge their vertices or delete them"
        )
