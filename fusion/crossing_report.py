"""How many edges of a fusion's frames cross the body and the garment itself, for its report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion.inputs import FusionInputs
from fusion.obstacles.crossing_fractions import BodyCrossings
from fusion.obstacles.crossings import EdgeCrossings
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


class CrossingReport:
    """Counts crossing edges of one batch after the other; one thread at a time.

    Args:
        mesh: the template. inputs: of any frames; whether there is a body, and its faces.
        device: where vertices are.
    """

    def __init__(self, mesh: Mesh, inputs: FusionInputs, device: torch.device) -> None:
        count = len(mesh.vertices)
        self._itself = EdgeCrossings(
            mesh.edges, mesh.faces, count, itself=True, device=device, name="garment"
        )
        self._n_edges = len(mesh.edges)
        self._body: BodyCrossings | None = None
        if inputs.body is not None:
            self._body = BodyCrossings(
                mesh.faces,
                count,
                np.asarray(inputs.body.faces),
                inputs.body.vertices.shape[1],
                device=device,
            )

    def fractions(self, before: torch.Tensor, after: torch.Tensor, inputs: FusionInputs) -> CrossingFractions:
        """Of vertices (T, N, 3) before and after the clean-up, metres, and `inputs` of the same frames.

        Looked at are the clip's first frame and every fourth after it, however it is cut into batches.
        """
        frames = slice(-inputs.first_frame % EVERY, None, EVERY)
        before, after = before[frames], after[frames]
        if not len(after):
            return CrossingFractions(None, np.zeros(0))
        itself = self._itself.query(after).counts().cpu().numpy() / self._n_edges
        if self._body is None or inputs.body is None:
            return CrossingFractions(None, itself)
        body = inputs.body.vertices[frames]
        fractions = [self._body.fractions(vertices, body) for vertices in (before, after)]
        return CrossingFractions((fractions[0], fractions[1]), itself)
