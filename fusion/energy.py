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
from fusion.recorder import Recorder
from fusion.stencil import ShownFaces, Stencil

TERMS = ("edge_length_m2", "displacement_m2", "normal_consistency", "normal_rendering", "temporal_m2")


class Energy:
    """Objective and gradient of T frames.

    Buffers are kept from one evaluation to the next: write into `vertices`, call `evaluate`, read `gradient`.

    Args:
        stencil: of the template.
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
        stencil: Stencil,
        weights: Mapping[str, float],
        anchor: torch.Tensor,
        share: torch.Tensor,
        *,
        shown: ShownFaces | None = None,
        target: torch.Tensor | None = None,
        confidence: torch.Tensor | None = None,
    ) -> None:
        frames, count, _ = anchor.shape
        self._shape = (frames, count)
        self._weights = {name: weights.get(name, 0.0) for name in TERMS}
        self.coupled = self._weights["temporal_m2"] > 0
        self.vertices = anchor.clone(memory_format=torch.contiguous_format)
        self.gradient = torch.zeros_like(self.vertices)
        self.active = torch.ones(frames, dtype=torch.int32, device=anchor.device)
        # One value a vertex and term, and one a face with pixels; a row of zeros where there are no such faces.
        self._energies = anchor.new_zeros(frames, 3, count)
        self._pixel_energies = anchor.new_zeros(frames, len(shown.faces) if shown else 1)
        n_edges, n_pixels = max(len(stencil.neighbours) // 2, 1), max(len(shown.places) if shown else 1, 1)
        divisors = torch.tensor([n_edges, 1, n_edges, n_pixels, 1], dtype=torch.float64)
        self._divisors = divisors.to(anchor.device)
        self.factors = torch.tensor(list(self._weights.values()), dtype=torch.float64).to(anchor.device)
        self._record = Recorder(anchor, self.active, frames)
        through = self._record_normals(stencil, shown, target, confidence)
        share = share.to(anchor).expand(frames, -1)
        place, lists = self._record, self._lists(stencil)
        place(
            "gradient",
            count,
            place.vectors(self.vertices),
            *lists["neighbours"],
            place.reals(torch.from_numpy(stencil.rest_lengths)),
            self._weights["edge_length_m2"] / n_edges,
            place.vectors(anchor),
            place.reals(share),
            self._weights["displacement_m2"],
            *lists["corners"],
            through,
            place.vectors(self.gradient),
            place.reals(self._energies),
        )

    def evaluate(self) -> torch.Tensor:
        """(T, 5) float64: the terms in the order of TERMS, unweighted; fills `gradient` of the weighted sum."""
        self._record.run()
        sums = self._energies.sum(-1, dtype=torch.float64)
        pixels = self._pixel_energies.sum(-1, keepdim=True, dtype=torch.float64)
        temporal = torch.zeros_like(pixels)
        if self.coupled:
            temporal[:, 0] = self._add_temporal()
        return torch.cat([sums, pixels, temporal], dim=1) / self._divisors

    def _add_temporal(self) -> torch.Tensor:
        """(T,) the temporal term; adds its gradient."""
        value, gradient = second_difference(self.vertices)
        self.gradient.add_(gradient, alpha=self._weights["temporal_m2"])
        return value.double()

    def _lists(self, stencil: Stencil) -> dict[str, list[Any]]:
        ints = self._record.ints
        return {
            "neighbours": [ints(stencil.neighbour_start), ints(stencil.neighbours)],
            "corners": [ints(stencil.corner_start), ints(stencil.corners)],
        }

    def _record_normals(
        self,
        stencil: Stencil,
        shown: ShownFaces | None,
        target: torch.Tensor | None,
        confidence: torch.Tensor | None,
    ) -> Any:
        """Launches for both normal terms; returns their gradient in the sums of face normals, None without them."""
        weights, place, (frames, count) = self._weights, self._record, self._shape
        if not (weights["normal_rendering"] or weights["normal_consistency"]):
            return None
        lists = self._lists(stencil)
        new = self.vertices.new_zeros
        normal, inverse = place.vectors(new(frames, count, 3)), place.reals(new(frames, count))
        through = place.vectors(new(frames, count, 3))
        place("normals", count, place.vectors(self.vertices), *lists["corners"], normal, inverse)
        of_pixels, corners_shown = place.vectors(new(frames, 1, 3)), [np.zeros(count + 1), np.zeros(1)]
        if shown is not None and target is not None:
            of_corners = new(frames, len(shown.faces), 3, 3)
            corners_shown = [shown.shown_start, shown.shown]
            place(
                "pixels",
                len(shown.faces),
                normal,
                place.ints(shown.faces),
                place.ints(shown.pixel_start),
                place.vectors(torch.from_numpy(shown.weights)),
                place.vectors(target),
                None if confidence is None else place.reals(confidence),
                place.vectors(of_corners),
                place.reals(self._pixel_energies),
            )
            of_pixels = place.vectors(of_corners.view(frames, -1, 3))
        place(
            "through_normals",
            count,
            normal,
            inverse,
            of_pixels,
            *map(place.ints, corners_shown),
            *lists["neighbours"],
            weights["normal_rendering"] / float(self._divisors[3]),
            weights["normal_consistency"] / float(self._divisors[2]),
            through,
            place.reals(self._energies),
        )
        return through
