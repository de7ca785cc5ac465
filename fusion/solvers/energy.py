"""The smooth part of the fusion's objective and its gradient, evaluated by Warp kernels for a batch of frames.

The numbers are those of `fusion.losses`; with the gradient written by hand they cost a fraction of what automatic
differentiation of sparse products does, on the CPU and on CUDA.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from fusion.losses import second_difference
from fusion.solvers.pixel_faces import PixelFaces
from fusion.solvers.recorder import Recorder
from fusion.topology import Topology

TERMS = ("edge_length_m2", "displacement_m2", "normal_consistency", "normal_rendering", "temporal_m2")


class Energy:
    """Objective and gradient of T frames.

    Buffers are kept from one evaluation to the next: write into `vertices`, call `evaluate`, read `gradient`.

    Args:
        topology: of the template.
        weights: of the terms, by their names in TERMS; a missing one is 0, which leaves the term out.
        anchor: (T, N, 3) float32 or float64, metres, where displacements are measured from; sets device and dtype.
        share: (T, N) or (1, N), what each vertex's squared displacement counts (1 / N for a mean).
        shown: pixels; goes with `target`.
        target: (T, P, 3) unit normals at `shown.places`.
        confidence: (T, P), what each pixel counts; 1 if None.

    Attributes:
        vertices, gradient: (T, N, 3).
        active: (T,) int32; frames with 0 keep the gradient and terms of their last evaluation.
        factors: (5,) float64, the weights in the order of TERMS.
        coupled: whether the frames depend on each other (the temporal term).
    """

    def __init__(
        self,
        topology: Topology,
        weights: Mapping[str, float],
        anchor: torch.Tensor,
        share: torch.Tensor,
        *,
        shown: PixelFaces | None = None,
        target: torch.Tensor | None = None,
        confidence: torch.Tensor | None = None,
    ) -> None:
        frames, count, _ = anchor.shape
        self._weights = {name: weights.get(name, 0.0) for name in TERMS}
        self.coupled = self._weights["temporal_m2"] > 0
        self.vertices = anchor.clone(memory_format=torch.contiguous_format)
        self.gradient = torch.zeros_like(self.vertices)
        self.active = torch.ones(frames, dtype=torch.int32, device=anchor.device)
        pixels = shown is not None and target is not None
        # One value a vertex, edge or face with pixels; a zero where there are none.
        self._of_vertices = anchor.new_zeros(frames, count)
        self._of_edges = anchor.new_zeros(frames, 2, max(len(topology.edges), 1))
        self._of_faces = anchor.new_zeros(frames, len(shown.faces) if shown and pixels else 1)
        n_edges, n_pixels = max(len(topology.edges), 1), max(len(shown.places) if shown else 1, 1)
        self._divisors = torch.tensor([n_edges, 1, n_edges, n_pixels, 1], dtype=torch.float64).to(
            anchor.device
        )
        self.factors = torch.tensor(list(self._weights.values()), dtype=torch.float64).to(anchor.device)
        self._record = place = Recorder(anchor, self.active)
        vertices, gradient = place.vectors(self.vertices), place.vectors(self.gradient)
        normal = through = None
        if self._weights["normal_rendering"] or self._weights["normal_consistency"]:
            normal, through = (place.vectors(anchor.new_zeros(frames, count, 3)) for _ in range(2))
        place(
            "begin",
            count,
            vertices,
            place.vectors(anchor),
            place.reals(share.to(anchor).expand(frames, -1)),
            self._weights["displacement_m2"],
            normal,
            through,
            gradient,
            place.reals(self._of_vertices),
        )
        faces = place.ints(topology.faces)
        if normal is not None:
            inverse = place.reals(anchor.new_zeros(frames, count))
            place("face_normals", len(topology.faces), vertices, faces, normal)
            place("unit_normals", count, normal, inverse)
            if shown is not None and target is not None:
                self._record_pixels(shown, target, confidence, normal, through)
        starts = np.searchsorted(topology.edges[:, 0], np.arange(count + 1))
        place(
            "along_edges",
            count,
            vertices,
            place.ints(starts),
            place.ints(topology.edges[:, 1]),
            place.reals(topology.rest_lengths),
            self._weights["edge_length_m2"] / n_edges,
            normal,
            self._weights["normal_consistency"] / n_edges,
            through,
            gradient,
            place.reals(self._of_edges),
        )
        if normal is not None:
            place("through_normals", count, normal, inverse, through)
            place("through_faces", len(topology.faces), vertices, faces, through, gradient)

    def evaluate(self) -> torch.Tensor:
        """(T, 5) float64: the terms in the order of TERMS, unweighted; fills `gradient` of the weighted sum."""
        self._record.run()
        edge, consistency = self._of_edges.sum(-1).double().unbind(1)
        displacement = self._of_vertices.sum(-1).double()
        pixels = self._of_faces.sum(-1).double()
        temporal = self._add_temporal() if self.coupled else torch.zeros_like(edge)
        terms = torch.stack([edge, displacement, consistency, pixels, temporal], dim=1)
        return terms / self._divisors

    def _add_temporal(self) -> torch.Tensor:
        """(T,) the temporal term; adds its gradient."""
        value, gradient = second_difference(self.vertices)
        self.gradient.add_(gradient, alpha=self._weights["temporal_m2"])
        return value.double()

    def _record_pixels(
        self,
        shown: PixelFaces,
        target: torch.Tensor,
        confidence: torch.Tensor | None,
        normal: Any,
        through: Any,
    ) -> None:
        """The launch for the rendered normals."""
        place = self._record
        place(
            "pixels",
            len(shown.faces),
            normal,
            place.ints(shown.faces),
            place.ints(shown.pixel_start),
            place.vectors(torch.from_numpy(shown.weights)),
            place.vectors(target),
            None if confidence is None else place.reals(confidence),
            self._weights["normal_rendering"] / float(self._divisors[3]),
            through,
            place.reals(self._of_faces),
        )
