"""Vertices that no reading shows, from those that do: the template's shape, turned as the cloth around it is turned."""

from __future__ import annotations

from threading import Lock

import numpy as np
import scipy.sparse
import torch
from scipy.sparse.csgraph import connected_components

from fusion.filling_system import FillingSystem
from fusion.layer_links import Links, links_across_seams, links_to_layers, links_to_pieces
from render.mesh.mesh import Mesh


class Filling:
    """Puts vertices that were not read where those that were, and the shape at rest, want them.

    Around every vertex the cloth is turned against its shape at rest, by the rotation that fits the edges between
    seen vertices best. The sums that tell it (edge · the same edge at rest, weighted) are continued harmonically over
    the vertices that are not seen, and tell rotations there. Those vertices then lie so that their edges are, in the
    sense of least squares, the ones at rest as these rotations turn them. The shape at rest and all its rigid motions
    are hence filled exactly. Both steps solve the same system.

    Where cloth lies in layers, vertices that are not seen hold on to the layer next to them as to their own neighbours
    (`fusion.layer_links`), and so stay on their side of it.

    The system of the usual vertices is factorised once. Frames that lack other ones get one of their own together.

    Args:
        mesh: the shape at rest, N vertices.
        seen: (N,) bool, the vertices that frames usually have readings of; one at least.
        as_read: (N, 3) where readings put the vertices at rest, so that it is without fault that they err alike in
            every frame; None: in their places.
    """

    def __init__(self, mesh: Mesh, seen: np.ndarray, as_read: np.ndarray | None = None) -> None:
        self._mesh, self._usual = mesh, seen
        self._as_read = mesh.vertices if as_read is None else np.where(seen[:, None], as_read, mesh.vertices)
        first, second = mesh.edges.T
        joined = scipy.sparse.coo_matrix((np.ones(len(first)), (first, second)), shape=(len(seen), len(seen)))
        _, self._piece = connected_components(joined, directed=False)
        layers = links_to_layers(mesh, self._piece, ~seen)
        self._links = Links.edges_of(mesh) + links_across_seams(mesh, self._piece, ~seen) + layers
        self._of_pieces: dict[bytes, Links] = {}  # by which pieces have a vertex that is seen
        of_piece = np.bincount(self._piece, weights=seen) / np.bincount(self._piece)  # the part that is seen
        part = of_piece[self._piece]
        here, there = layers.pairs.T
        #: (N,) bool, usually not seen, and against a layer that carries it, or in a piece without a seen vertex. What
        #: carries it is seen, or of a piece of which no less is seen.
        self.layered = part == 0
        self.layered[here[seen[there] | (part[there] >= part[here])]] = True
        self._systems: dict[tuple[torch.device, bool], FillingSystem] = {}
        self._lock = Lock()

    def __call__(self, vertices: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        """Fill in.

        Args:
            vertices: (T, N, 3) metres, float32 or float64; those that are not seen may hold any number.
            seen: (T, N) bool, one at least in every frame.

        Returns:
            (T, N, 3), same dtype and device; seen vertices as they are.
        """
        usual = (seen == torch.from_numpy(self._usual).to(seen.device)).all(-1)
        if usual.all():
            return self._usual_system(vertices.device)(vertices)
        filled = vertices.clone()
        if usual.any():
            filled[usual] = self._usual_system(vertices.device)(vertices[usual])
        frames = vertices[~usual]
        system = self._system(seen[~usual].cpu().numpy(), self._as_read, vertices.device)
        filled[~usual] = system(frames.reshape(1, -1, 3)).reshape(frames.shape)
        return filled

    def put_back(self, vertices: torch.Tensor) -> torch.Tensor:
        """Layers that are usually not seen, put against the cloth next to them again.

        Edges alone do not keep them there while that cloth moves.

        Args:
            vertices: (T, N, 3) metres, float32 or float64.

        Returns:
            (T, N, 3); vertices that are not `layered` as they are.
        """
        return self._usual_system(vertices.device, layers=True)(vertices) if self.layered.any() else vertices

    def _usual_system(self, device: torch.device, *, layers: bool = False) -> FillingSystem:
        """Of the vertices that are usually not seen, or of the layers among them."""
        with self._lock:  # of several threads, the first one makes it
            if (device, layers) not in self._systems:
                known = ~self.layered if layers else self._usual
                places = (
                    self._mesh.vertices if layers else self._as_read
                )  # solved vertices err no more at rest
                self._systems[device, layers] = self._system(known[None], places, device)
            return self._systems[device, layers]

    def _system(self, seen: np.ndarray, places: np.ndarray, device: torch.device) -> FillingSystem:
        """Of frames in which these vertices (T, N) are seen, and are at `places` (N, 3) at rest."""
        pieces = [
            self._links_of_pieces(frame).moved(number * len(frame)) for number, frame in enumerate(seen)
        ]
        near = ~seen
        for part in pieces:
            near.reshape(-1)[part.pairs] = True
        links = sum(pieces, _of_frames(self._links, near))
        rest = np.where(seen[..., None], places, self._mesh.vertices)
        return FillingSystem(rest, links, seen, device=device)

    def _links_of_pieces(self, seen: np.ndarray) -> Links:
        """Of the pieces without a seen vertex."""
        known = np.bincount(self._piece, weights=seen) > 0
        key = known.tobytes()
        if key not in self._of_pieces:
            self._of_pieces[key] = links_to_pieces(self._mesh, self._piece, known)
        return self._of_pieces[key]


def _of_frames(links: Links, near: np.ndarray) -> Links:
    """The links within each frame's vertices, which are counted on from frame to frame.

    Those alone that have an end at one of the vertices `near` (T, N) or at a neighbour of one: the others tell nothing.
    """
    first, second = links.pairs.T
    near = near.copy()
    frame, link = np.nonzero(near[:, first] | near[:, second])
    near[frame, first[link]] = near[frame, second[link]] = True
    frame, link = np.nonzero(near[:, first] | near[:, second])
    return Links(links.pairs[link] + frame[:, None] * near.shape[1], links.stiffness[link])
