"""Faults of a garment's connectivity."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from imgtransfer.importers.checks.findings import MeshFault
from imgtransfer.importers.checks.weld import seam_groups
from render import Mesh, Option


def check_topology(garment: Mesh, *, welding: bool = False) -> list[MeshFault]:
    """Check a garment's connectivity: seams that were split, loose pieces, vertices and edges that do no work.

    Args:
        garment: metres. welding: whether seams will be welded, so that they are no fault.
    """
    faults = []
    first, count = seam_groups(garment), len(garment.vertices)
    joined = count - len(np.unique(first))
    if joined and not welding:
        text = f"{garment.source}: {joined} of {count} vertices lie on others, where seams were split (by texture "
        text += f"coordinates or panels); cloth would come apart there: add {Option('weld', True)}"
        faults.append(MeshFault("seams", text, True))
    faces = first[garment.faces]
    used = np.zeros(count, bool)
    used[garment.faces] = True
    pieces = _pieces(faces, count, np.unique(faces))
    if len(pieces) > 1:
        sizes = ", ".join(str(size) for size in pieces[:5]) + (" ..." if len(pieces) > 5 else "")
        text = f"{garment.source}: {len(pieces)} separate pieces ({sizes} vertices); they are taken as one garment"
        faults.append(MeshFault("pieces", text, False))
    if not used.all():
        text = f"{garment.source}: {(~used).sum()} vertices belong to no triangle (vertex {int(np.argmin(used))} first)"
        faults.append(MeshFault("unused", f"{text}; nothing can be recovered for them: delete them", False))
    halves = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(halves[halves[:, 0] != halves[:, 1]], axis=0, return_counts=True)
    if (uses > 2).any():
        text = (
            f"{garment.source}: {(uses > 2).sum()} edges have three or more triangles; cloth has one or two"
        )
        faults.append(MeshFault("edges", text, False))
    return faults


def used_part(mesh: Mesh) -> Mesh:
    """The mesh without the vertices that no triangle uses, which are neither cloth nor skin wherever they lie."""
    used = np.zeros(len(mesh.vertices), bool)
    used[mesh.faces] = True
    if used.all():
        return mesh
    number = np.cumsum(used) - 1
    return Mesh(mesh.vertices[used], number[mesh.faces], mesh.source)


def _pieces(faces: np.ndarray, count: int, used: np.ndarray) -> list[int]:
    """Sizes of the connected pieces, in vertices, largest first; vertices without triangles are left out."""
    start, end = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    _, label = connected_components(
        coo_array((np.ones(len(start)), (start, end)), shape=(count, count)), directed=False
    )
    return sorted(np.bincount(label[used]).tolist(), reverse=True)[: len(np.unique(label[used]))]
