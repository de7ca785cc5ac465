"""The smooth part of the fusion's objective and its gradient, evaluated by Warp kernels for a batch of frames.

The numbers are those of `fusion.losses`; with the gradient written by hand they cost a fraction of what automatic
differentiation of sparse products does, on the CPU and on CUDA.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from fusion.solvers.pixel_faces import PixelFaces
from fusion.solvers.recorder import Recorder, frames_last, lanes_on
from fusion.topology import Topology

TERMS = ("edge_length_m2", "displacement_m2", "normal_consistency", "normal_rendering")


class Energy:
    """Objective and gradient of T frames.

    Buffers are kept from one evaluation to the next: write into `vertices`, call `evaluate`, read `gradient`.

    Args:
        topology: of the template.
        weights: of the terms, by their names in TERMS; a missing one is 0, which leaves the term out.
        anchor: (T, N, 3) float32 or float64, metres, where displacements are measured from; sets device and dtype.
        vertex_weights: (T, N) or (1, N), what each vertex's squared displacement counts (1 / N for a mean).
        pixel_faces: the covered pixels, by face; goes with `target`.
        target: (T, P, 3) unit normals at `pixel_faces.places`.
        confidence: (T, P), what each pixel counts; 1 if None.

    Attributes:
        vertices, gradient: (T, N, 3), in memory as `frames_last` makes them.
        active: (T,), 1 for frames that take part, and 0; `activate` sets it.
        busy: (G,) int32, whether any frame of a group is active; groups of others keep gradient and terms of their last
            evaluation.
        factors: (4,) float64, the weights in the order of TERMS.
    """

    def __init__(
        self,
        topology: Topology,
        weights: Mapping[str, float],
        anchor: torch.Tensor,
        vertex_weights: torch.Tensor,
        *,
        pixel_faces: PixelFaces | None = None,
        target: torch.Tensor | None = None,
        confidence: torch.Tensor | None = None,
    ) -> None:
        frames, count, _ = anchor.shape
        self._weights = {name: weights.get(name, 0.0) for name in TERMS}
        self.vertices, self.gradient = (frames_last(*anchor.shape, like=anchor) for _ in range(2))
        self.vertices.copy_(anchor)
        groups = -(-frames // lanes_on(anchor.device))
        self._whole_active = anchor.new_zeros(groups * lanes_on(anchor.device))
        self.active = self._whole_active[:frames]
        self._any_active = torch.zeros(groups, dtype=torch.bool, device=anchor.device)
        self.busy = torch.zeros(groups, dtype=torch.int32, device=anchor.device)
        self.activate(torch.ones(frames, dtype=torch.bool, device=anchor.device))
        pixels = pixel_faces is not None and target is not None
        # What each vertex or face with pixels adds to a term; a zero where there are none.
        # Of whole groups, so that sums are taken in the same order whatever frames are in them.
        self._of_vertices = frames_last(len(self._whole_active), 3, count, like=anchor)
        with_pixels = len(pixel_faces.faces) if pixel_faces and pixels else 1
        self._pixels = frames_last(len(self._whole_active), with_pixels, like=anchor)
        on_edges, displacements, consistencies = self._of_vertices.unbind(1)
        n_edges, n_pixels = max(len(topology.edges), 1), max(len(pixel_faces.places) if pixel_faces else 1, 1)
        self._divisors = torch.tensor([n_edges, 1, n_edges, n_pixels], dtype=torch.float64).to(anchor.device)
        self.factors = torch.tensor(list(self._weights.values()), dtype=torch.float64).to(anchor.device)
        self._terms = torch.zeros(
            len(TERMS), len(self._whole_active), dtype=torch.float64, device=anchor.device
        )
        self._totals = record = Recorder(anchor, self.busy)
        of_vertices, of_pixels = record.frames(self._of_vertices), record.frames(self._pixels)
        record("total_terms", (len(TERMS),), of_vertices, of_pixels, record.doubles(self._terms))
        self._recorder = record = Recorder(anchor, self.busy)
        vertices, gradient = record.frames(self.vertices), record.frames(self.gradient)
        normal = normal_gradient = None
        if self._weights["normal_rendering"] or self._weights["normal_consistency"]:
            normal, normal_gradient = (
                record.frames(frames_last(*anchor.shape, like=anchor)) for _ in range(2)
            )
        record(
            "begin",
            count,
            vertices,
            record.frames(anchor),
            record.frames(vertex_weights.to(anchor).expand(frames, -1)),
            self._weights["displacement_m2"],
            normal,
            normal_gradient,
            gradient,
            record.frames(displacements),
        )
        starts = record.ints(np.searchsorted(topology.edges[:, 0], np.arange(count + 1)))
        seconds = record.ints(topology.edges[:, 1])
        record(
            "along_edges",
            count,
            vertices,
            starts,
            seconds,
            record.reals(topology.rest_lengths),
            self._weights["edge_length_m2"] / n_edges,
            gradient,
            record.frames(on_edges),
        )
        if normal is None:
            return
        faces, inverse = record.ints(topology.faces), record.frames(frames_last(frames, count, like=anchor))
        record("face_normals", len(topology.faces), vertices, faces, normal)
        record("unit_normals", count, normal, inverse)
        if pixel_faces is not None and target is not None:
            self._record_pixels(pixel_faces, target, confidence, normal, normal_gradient)
        weight = self._weights["normal_consistency"] / n_edges
        record(
            "between_normals",
            count,
            normal,
            starts,
            seconds,
            weight,
            normal_gradient,
            record.frames(consistencies),
        )
        record("through_normals", count, normal, inverse, normal_gradient)
        record("through_faces", len(topology.faces), vertices, faces, normal_gradient, gradient)

    def activate(self, frames: torch.Tensor) -> None:
        """Let these frames (T,) bool take part."""
        self.active.copy_(frames)
        torch.any(self._whole_active.view(len(self.busy), -1), 1, out=self._any_active)
        self.busy.copy_(self._any_active)

    def evaluate(self) -> torch.Tensor:
        """(T, 4) float64: the terms in the order of TERMS, unweighted; fills `gradient` of the weighted sum."""
        self._recorder.run()
        self._totals.run()
        return self._terms[:, : len(self.active)].T / self._divisors

    def _record_pixels(
        self,
        pixel_faces: PixelFaces,
        target: torch.Tensor,
        confidence: torch.Tensor | None,
        normal: Any,
        normal_gradient: Any,
    ) -> None:
        """The launch for the rendered normals."""
        record = self._recorder
        record(
            "pixels",
            len(pixel_faces.faces),
            normal,
            record.ints(pixel_faces.faces),
            record.ints(pixel_faces.pixel_start),
            record.vectors(torch.from_numpy(pixel_faces.weights)),
            record.frames(target),
            None if confidence is None else record.frames(confidence),
            self._weights["normal_rendering"] / float(self._divisors[3]),
            normal_gradient,
            record.frames(self._pixels),
        )
