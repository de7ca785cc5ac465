"""How a body's surface moves at some of its vertices: read off the body's meshes, without skinning weights."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from imgtransfer.data.clip_parts import Body
from imgtransfer.deformers.common.rotations import nearest_rotation

RINGS = 2  # of neighbours that a rotation is fitted to: about twenty vertices


def surface_motion(
    body: Body, vertices: np.ndarray, posed: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Rigid motions R x + T, rest to posed, of the surface around body vertices.

    R is Kabsch's fit to the vertices within `RINGS` edges, and the vertex itself moves exactly as it does.

    Args:
        vertices: (A,) int, of the body.
        posed: (T, B, 3) the body in motion, in a frame of the caller's; the body's own if None.

    Returns:
        R (T, A, 3, 3) and T (T, A, 3) float64.
    """
    posed = body.vertices if posed is None else posed
    rest = body.rest.astype(np.float64)
    near = _neighbourhoods(body.faces, len(rest))[vertices].tocoo()
    arm = rest[near.coords[1]] - rest[vertices][near.coords[0]]
    sums = csr_array((np.ones(len(arm)), (near.coords[0], np.arange(len(arm)))), (len(vertices), len(arm)))
    rotation = np.empty((len(posed), len(vertices), 3, 3))
    for frame, place in zip(rotation, posed, strict=True):
        turned = place[near.coords[1]].astype(np.float64) - place[vertices][near.coords[0]]
        products = (turned[:, :, None] * arm[:, None]).reshape(-1, 9)
        frame[:] = nearest_rotation((sums @ products).reshape(-1, 3, 3))
    translation = posed[:, vertices] - np.einsum("tnab,nb->tna", rotation, rest[vertices])
    return rotation, translation


def _neighbourhoods(faces: np.ndarray, n_vertices: int) -> csr_array:
    """(B, B): 1 where the column's vertex is within `RINGS` edges of the row's."""
    start, end = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    ones = np.ones(2 * len(start))
    edges = csr_array(
        (ones, (np.concatenate([start, end]), np.concatenate([end, start]))), (n_vertices, n_vertices)
    )
    reach = edges
    for _ in range(RINGS - 1):
        reach = reach + reach @ edges
    reach.data[:] = 1.0
    return reach
