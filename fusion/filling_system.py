"""The two linear systems of `fusion.filling`, for one set of vertices that are seen."""

from __future__ import annotations

import warnings

import numpy as np
import scipy.sparse
import torch

from fusion.layer_links import Links
from render.mesh.factor import Factor

# Part of its neighbours in what tells a vertex's rotation: all there is where the edges around it have unseen ends.
_NEIGHBOURS = 0.1
# Parts of the whole garment in it, and of no rotation at all: for where nothing else tells one.
_WHOLE, _UNTURNED = 1e-5, 1e-7
# Newton's iteration for rotations: steps at most, and the change of entries after which a step would change nothing.
_POLAR_STEPS, _POLAR_TOLERANCE = 12, 1e-7
_FULL = 1e-9  # what is added to the diagonal of a matrix of size 1, lest it have no inverse


class FillingSystem:
    """What is constant while the same vertices are seen.

    Args:
        rest: (F, N, 3) float64, metres, the shape at rest of each of F garments; their vertices are counted on from
            one to the next.
        links: which pairs keep their offsets at rest but for a rotation. Along them, every vertex that is not seen must
            be connected with one that is. Those between seen vertices tell rotations.
        seen: (F, N) bool, one at least of each garment.
        device: of the vertices.
    """

    def __init__(self, rest: np.ndarray, links: Links, seen: np.ndarray, *, device: torch.device) -> None:
        garment = np.repeat(np.arange(len(seen)), seen.shape[1])
        rest, seen = rest.reshape(-1, 3), seen.reshape(-1)
        self._unseen = torch.from_numpy(np.flatnonzero(~seen)).to(device)
        if seen.all():
            return
        loose = ~seen[links.pairs].all(1)
        # From here on, vertices are counted within those that are not seen and their neighbours.
        active = np.zeros(len(seen), bool)
        active[links.pairs[loose]] = True
        numbers, place = np.flatnonzero(active), np.cumsum(active) - 1
        count = self._count = len(numbers)
        inside, border = np.flatnonzero(~seen[numbers]), np.flatnonzero(seen[numbers])
        self._inside, self._border = (torch.from_numpy(part).to(device) for part in (inside, border))
        self._seen_neighbours = torch.from_numpy(numbers[border]).to(device)
        pairs, stiffness = place[links.pairs[loose]], links.stiffness[loose]
        here, there = np.concatenate([pairs, pairs[:, ::-1]]).T
        stiffness = np.tile(stiffness, 2)
        pull = scipy.sparse.csr_matrix((stiffness, (here, there)), shape=(count, count))
        total = np.asarray(pull.sum(1)).ravel()
        own = pull[inside]
        self._factor = Factor(scipy.sparse.diags(total[inside]) - own[:, inside], device, torch.float64)
        self._from_border = _Product(own[:, border], device)
        self._mean = _Product(scipy.sparse.diags(_NEIGHBOURS / total) @ pull, device)
        extent = rest[numbers[here]] - rest[numbers[there]]
        offset = extent * stiffness[:, None]
        unturned = _UNTURNED * np.bincount(here, (extent * offset).sum(1))[:, None] * np.eye(3).ravel()
        self._unturned = torch.from_numpy(unturned).to(device)
        whole = scipy.sparse.csr_matrix((np.ones(count), (garment[numbers], np.arange(count))))
        whole = scipy.sparse.diags(_WHOLE / np.asarray(whole.sum(1)).ravel().clip(min=1)) @ whole
        self._garment = torch.from_numpy(garment[numbers]).to(device)
        self._whole = _Product(whole, device)
        rows = np.cumsum(~seen[numbers]) - 1
        kept = ~seen[numbers[here]]
        self._offsets = _Product(
            _turned(rows[here[kept]], here[kept], there[kept], offset[kept], (len(inside), count)), device
        )
        self._shapes = _Product(_shape_sums(rest, links, seen, active), device)

    def __call__(self, vertices: torch.Tensor) -> torch.Tensor:
        """(T, N, 3) with the vertices that are not seen put in their places, same dtype; the others as they are."""
        if not len(self._unseen):
            return vertices
        exact = vertices.double()
        right = self._offsets(self._rotations(exact)) + self._from_border(exact[:, self._seen_neighbours])
        return vertices.index_copy(1, self._unseen, self._factor.solve(right).to(vertices))

    def _rotations(self, vertices: torch.Tensor) -> torch.Tensor:
        """(T, 3 count, 3) of the active vertices: row 3 i + k is where axis k goes at vertex i."""
        frames = len(vertices)
        sums = self._shapes(vertices).reshape(frames, self._count, 9)
        known = self._from_border(sums[:, self._border])
        inside = self._factor.solve(
            known.reshape(frames, -1, 3, 3).transpose(1, 2).reshape(frames * 3, -1, 3)
        )
        inside = inside.reshape(frames, 3, -1, 3).transpose(1, 2).reshape(frames, -1, 9)
        sums = sums.index_copy(1, self._inside, inside)
        sums = sums + self._mean(sums)
        sums = sums + self._whole(sums)[:, self._garment] + self._unturned
        return nearest_rotations(sums.reshape(frames, -1, 3, 3)).reshape(frames, -1, 3)


def nearest_rotations(matrices: torch.Tensor) -> torch.Tensor:
    """The rotations nearest to matrices (..., 3, 3) of floating point; the identity for 0.

    By Newton's iteration for the polar factor (Higham 1986), many times as fast as singular values are. The matrix of
    cofactors, which the same rotation turns, is added first: without it, what is flat or a line has no polar factor. Of
    the rotations that fit a line alike it takes the one that turns least. Where a mirror image fits as well as any
    rotation, it is some rotation.
    """
    x = matrices.movedim((-2, -1), (0, 1))  # entries first: sums over them run over long rows
    one = torch.eye(3).to(x).reshape(3, 3, *[1] * (x.ndim - 2))
    size = _size(x)
    x = torch.where(size > 0, x / size.clamp(min=torch.finfo(x.dtype).tiny), one) + _FULL * one
    cofactors = _cofactors(x)
    both = x + cofactors * (2**0.5)
    x = torch.where((both[0] * _cofactors(both)[0]).sum(0) > 0, both, cofactors)
    for _ in range(_POLAR_STEPS):
        before, cofactors = x, _cofactors(x)
        inverse = cofactors / (x[0] * cofactors[0]).sum(0)
        scale = (_size(inverse) / _size(x)).sqrt()
        x = (x * scale + inverse / scale) / 2
        if bool(((x - before).abs() < _POLAR_TOLERANCE).all()):
            break
    return torch.where(x.isfinite().all(0).all(0), x, one).movedim((0, 1), (-2, -1))


def _size(x: torch.Tensor) -> torch.Tensor:
    """Frobenius norm of matrices (3, 3, ...)."""
    return x.square().sum((0, 1)).sqrt()


def _cofactors(x: torch.Tensor) -> torch.Tensor:
    """Of matrices (3, 3, ...): the transposed inverse times the determinant."""
    next_and_last = {(i, j): x.roll((-i, -j), (0, 1)) for i in (1, 2) for j in (1, 2)}
    return next_and_last[1, 1] * next_and_last[2, 2] - next_and_last[1, 2] * next_and_last[2, 1]


def _shape_sums(
    rest: np.ndarray, links: Links, seen: np.ndarray, active: np.ndarray
) -> scipy.sparse.csr_matrix:
    """(3 A, N) from vertices to Σ stiffness · component k of the link at rest · the link, at row 3 i + k of vertex i.

    Over the links between seen vertices; 0 at the others.
    """
    used = seen[links.pairs].all(1)
    pairs = np.concatenate([links.pairs[used], links.pairs[used][:, ::-1]])
    stiffness = np.tile(links.stiffness[used], 2)
    kept = active[pairs[:, 0]]
    (here, there), stiffness = pairs[kept].T, stiffness[kept]
    offset = (rest[here] - rest[there]) * stiffness[:, None]
    place, count = np.cumsum(active) - 1, int(active.sum())
    rows = (3 * place[here][:, None] + np.arange(3)).ravel()
    values, shape = offset.ravel(), (3 * count, len(seen))
    own = scipy.sparse.csr_matrix((values, (rows, np.repeat(here, 3))), shape=shape)
    return own - scipy.sparse.csr_matrix((values, (rows, np.repeat(there, 3))), shape=shape)


def _turned(
    rows: np.ndarray, here: np.ndarray, there: np.ndarray, offset: np.ndarray, shape: tuple[int, int]
) -> scipy.sparse.csr_matrix:
    """(rows, 3 count) from rotations, as `_rotations` gives them, to Σ offset from each neighbour, turned.

    By the mean of both ends' rotations, which is right to second order where cloth bends.
    """
    columns = [(3 * end[:, None] + np.arange(3)).ravel() for end in (here, there)]
    values = np.tile(offset.ravel() / 2, 2)
    places = np.tile(np.repeat(rows, 3), 2), np.concatenate(columns)
    return scipy.sparse.csr_matrix((values, places), shape=(shape[0], 3 * shape[1]))


class _Product:
    """A sparse matrix in float64 on a device, times (T, columns, C). Made fast, for matrices that are used once."""

    def __init__(self, matrix: scipy.sparse.csr_matrix, device: torch.device) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sparse CSR tensor support is in beta state", UserWarning)
            self._matrix = torch.sparse_csr_tensor(
                torch.from_numpy(matrix.indptr),
                torch.from_numpy(matrix.indices),
                torch.from_numpy(matrix.data),
                size=matrix.shape,
                device=device,
                check_invariants=False,
            )

    def __call__(self, dense: torch.Tensor) -> torch.Tensor:
        frames, columns, channels = dense.shape
        product = self._matrix @ dense.transpose(0, 1).reshape(columns, -1)
        return product.reshape(-1, frames, channels).transpose(0, 1)
