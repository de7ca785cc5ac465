"""From a field and its cuts to an even triangle mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.sparse import coo_matrix

from imgtransfer.garments.cutting import border_edges, cut_at_zero, largest_component, without_pinches
from imgtransfer.garments.field import Field
from render.extras import optional
from render.mesh.mesh import Mesh

Cut = Callable[[np.ndarray], np.ndarray]  # (N, 3) points -> (N,), positive where cloth is removed
_REMESHINGS = 10
_RELAXATIONS = 8


def cut_surface(field: Field, cuts: Sequence[Cut], edge_length: float, source: str) -> Mesh:
    """The field's zero level as an even mesh, cut, of one piece.

    Args:
        field: see `Field`.
        cuts: applied one after the other; of what is left the largest piece stays.
        edge_length: wanted length of edges, metres.
        source: what messages call the mesh.
    """
    gpytoolbox = optional("gpytoolbox", "simulate", "cutting garments")
    rough = field.surface(source)
    vertices, faces = gpytoolbox.remesh_botsch(
        rough.vertices, rough.faces.astype(np.int32), _REMESHINGS, edge_length, True
    )
    mesh = Mesh(vertices, faces, source)
    for cut in cuts:
        mesh = largest_component(without_pinches(cut_at_zero(mesh, cut(mesh.vertices))))
    return Mesh(relaxed(mesh, field), mesh.faces, source)


def relaxed(mesh: Mesh, field: Field) -> np.ndarray:
    """(N, 3) vertices evened out on the field's zero level: the inner ones over it, those of a border along it."""
    n = len(mesh.vertices)
    border = border_edges(mesh.faces)
    on_border = np.zeros(n, bool)
    on_border[border] = True
    inner = mesh.edges[~on_border[mesh.edges].all(axis=1)]
    pairs = np.concatenate([inner, inner[:, ::-1]])
    pairs = np.concatenate([pairs[~on_border[pairs[:, 0]]], border, border[:, ::-1]])
    mean = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(n, n)).tocsr()
    mean = mean.multiply(1 / np.maximum(mean.sum(axis=1), 1)).tocsr()
    vertices = mesh.vertices
    for _ in range(_RELAXATIONS):
        vertices = field.project(vertices + 0.5 * (mean @ vertices - vertices))
    return vertices
