"""How many edges of a fusion's frames cross the body and the garment itself, for its report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.obstacles.crossings import EdgeCrossings
from fusion.obstacles.surface_contact import SurfaceContact
from render.mesh.mesh import Mesh

EVERY = 4  # frames of a clip; counting in each took a fifth of a fusion's time


@dataclass(frozen=True, eq=False)
class CrossingFractions:
    """Crossing edges of S frames, over the number of the garment's edges.

    Args:
        body: (S,) of garment and body, before and after the clean-up; None without a body.
        itself: (S,) of the garment with itself, in the result.
    """

    body: tuple[np.ndarray, np.ndarray] | None
    itself: np.ndarray


@dataclass(frozen=True, eq=False)
class ClothAndBody:
    """The garment before and after the clean-up, and the body in the same frames.

    Args:
        surface: of an obstacle whose first surface is the body.
        before, after: vertices (T, N, 3) and distances (T, N), metres; no vertex is nearer to the obstacle.
    """

    surface: SurfaceContact
    before: tuple[torch.Tensor, torch.Tensor]
    after: tuple[torch.Tensor, torch.Tensor]

    def inside(self) -> tuple[np.ndarray, np.ndarray]:
        """The fractions (T,) of the vertices below an obstacle's surface, before and after the clean-up."""
        before, after = (
            (distance < 0).float().mean(-1).cpu().numpy() for _, distance in (self.before, self.after)
        )
        return before, after


class CrossingReport:
    """Counts crossing edges of one batch after the other; one thread at a time.

    Args:
        mesh: the template.
        device: where vertices are.
    """

    def __init__(self, mesh: Mesh, device: torch.device) -> None:
        self._itself = EdgeCrossings(
            mesh.edges, mesh.faces, len(mesh.vertices), itself=True, device=device, name="garment"
        )
        self._n_edges = len(mesh.edges)

    def fractions(
        self, vertices: torch.Tensor, first_frame: int, contact: ClothAndBody | None = None
    ) -> CrossingFractions:
        """Of vertices (T, N, 3), metres, the result of frames from `first_frame` of the clip on.

        Looked at are the clip's first frame and every fourth after it, however it is cut into batches.
        """
        numbers = range(-first_frame % EVERY, len(vertices), EVERY)
        frames = torch.tensor(numbers, dtype=torch.int64, device=vertices.device)
        itself = self._itself.counts(vertices[frames]).cpu().numpy() if len(frames) else np.zeros(0)
        fractions = None
        if contact is not None:
            before, after = (
                contact.surface.body_crossings(*cloth, frames).cpu().numpy() / self._n_edges
                for cloth in (contact.before, contact.after)
            )
            fractions = before, after
        return CrossingFractions(fractions, itself / self._n_edges)
