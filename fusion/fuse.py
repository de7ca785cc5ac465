"""Position and normal maps of a clip to vertices: section 3.3 of the paper from end to end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from fusion.adam import Minimum, edge_stage, normal_stage
from fusion.clearance import clear_body
from fusion.config import FusionConfig
from fusion.initialise import InitialWeights
from fusion.inputs import Array, FusionInputs
from fusion.sdf import BodySdf
from fusion.stopwatch import Stopwatch
from fusion.topology import Topology
from render.imager import TemplateImager
from render.mesh import safe_normalize
from render.operator import SparseProduct


@dataclass(frozen=True, eq=False)
class FusionResult:
    """Vertices recovered from maps.

    Args:
        vertices: (T, N, 3) float32, metres.
        initial: (T, N, 3) float32, metres, before any optimisation.
        report: plain numbers by name: `terms` at the start and end of each stage (mean over frames,
            unweighted, lengths in metres), `unseen_percent` of the vertices, `penetration_percent` before and
            after the clean-up (where there is a body), `seconds`, `seconds_per_frame`, `stage_seconds` (of all
            frames together: setup, start, edge, normal, clearance).
    """

    vertices: np.ndarray
    initial: np.ndarray
    report: dict[str, Any]


def fuse(
    imager: TemplateImager,
    *,
    positions: Array | None = None,
    normals: Array | None = None,
    initial: Array | None = None,
    body_vertices: Array | None = None,
    body_faces: Array | None = None,
    config: FusionConfig | None = None,
    device: str | torch.device = "cpu",
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from its maps.

    With position maps: initialisation and edge stage. Then, if there are normals or a body, the second stage
    with the terms that they allow, and with a body the clean-up. Frames are independent; the result does not
    depend on how they are batched beyond float rounding, and repeats exactly.

    Args:
        imager: of the garment's template, with the cameras of the maps.
        positions: (T, S, H, W, 3) metres (decoded by their box).
        normals: (T, S, H, W, 3) in [-1, 1] (decoded); only their directions count.
        initial: (T, N, 3) metres, vertices to start from instead of `positions`.
        body_vertices: (T, B, 3) metres, in the frame of the maps.
        body_faces: (G, 3) integers, counter-clockwise from outside.
        config: hyper-parameters; the paper's if None.
        device: torch device that computes.
        progress: called with the number of frames after each batch of them.

    Raises:
        InputError: neither or both of `positions` and `initial`; shapes that do not fit; values under the
            mask that are not finite; a template that no view sees.
    """
    config = config or FusionConfig()
    inputs = FusionInputs(
        imager,
        positions=positions,
        normals=normals,
        initial=initial,
        body_vertices=body_vertices,
        body_faces=body_faces,
    )
    started = time.perf_counter()
    pieces = []
    watch = Stopwatch(torch.device(device))
    with _one_thread():
        with watch.stage("setup"):
            solver = _Solver(imager, inputs, config, torch.device(device))
        for first in range(0, inputs.n_frames, config.batch_frames):
            pieces.append(solver.solve(slice(first, first + config.batch_frames), watch))
            if progress is not None:
                progress(len(pieces[-1].vertices))
    vertices, start = (np.concatenate([getattr(p, key) for p in pieces]) for key in ("vertices", "initial"))
    report = _report(pieces, time.perf_counter() - started)
    report["stage_seconds"] = watch.seconds
    report["unseen_percent"] = 100 * float(1 - imager.visible.any(axis=0).mean())
    return FusionResult(vertices, start, report)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep torch to one CPU thread: a step is a few dozen products of some 0.1 ms each, and threads wait for each
    other at every one. On a machine in use, two threads took between 0.86 times and 4 times as long as one,
    depending on what else ran (4,400 and 12,100 vertices, scripts/bench/fusion.py).
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


@dataclass(frozen=True, eq=False)
class _Piece:
    """One batch of frames, solved."""

    vertices: np.ndarray
    initial: np.ndarray
    stages: dict[str, Minimum]
    inside: (
        tuple[np.ndarray, np.ndarray] | None
    )  # (T,) share of vertices inside before and after the clean-up


class _Solver:
    """All that is constant over the frames, and the solution of a batch of them."""

    def __init__(
        self, imager: TemplateImager, inputs: FusionInputs, config: FusionConfig, device: torch.device
    ) -> None:
        self._inputs, self._config, self._device = inputs, config, device
        self._imager = imager
        self._topology = Topology(imager.mesh)
        self._weights = InitialWeights(imager) if inputs.positions is not None else None
        self._seen = torch.from_numpy(imager.visible.any(axis=0)).to(device, torch.float32)
        self._pixels, self._places = covered_pixels(imager)
        self._sdfs: tuple[BodySdf, BodySdf] | None = None
        if inputs.body_vertices is not None and inputs.body_faces is not None:
            faces, n = inputs.body_faces, inputs.body_vertices.shape[1]
            # The quick sign while optimising, the one that counts for the clean-up.
            self._sdfs = (
                BodySdf(faces, n, device=device, sign="normal"),
                BodySdf(faces, n, device=device, sign="winding"),
            )

    def solve(self, frames: slice, watch: Stopwatch) -> _Piece:
        """Both stages and the clean-up of some frames."""
        stages: dict[str, Minimum] = {}
        with watch.stage("start"):
            initial = vertices = self._start(frames)
            target = self._target(frames)
            for sdf in self._sdfs or ():
                assert self._inputs.body_vertices is not None
                sdf.update(self._inputs.body_vertices[frames])
        if self._weights is not None and self._config.edge_steps:
            with watch.stage("edge"):
                stages["edge"] = edge_stage(vertices, self._topology, self._seen, self._config)
            vertices = stages["edge"].vertices
        if self._config.normal_steps and (target is not None or self._sdfs is not None):
            with watch.stage("normal"):
                stages["normal"] = normal_stage(
                    vertices,
                    self._topology,
                    self._config,
                    pixels=self._pixels,
                    target=target,
                    sdf=self._sdfs[0] if self._sdfs else None,
                )
            vertices = stages["normal"].vertices
        inside = None
        if self._sdfs is not None:
            with watch.stage("clearance"):
                before = self._inside(vertices)
                vertices = clear_body(
                    vertices,
                    self._sdfs[1],
                    self._topology,
                    clearance_m=self._config.clearance_m,
                    rounds=self._config.clearance_rounds,
                )
                inside = before, self._inside(vertices)
        return _Piece(_array(vertices), _array(initial), stages, inside)

    def _start(self, frames: slice) -> torch.Tensor:
        """(T, N, 3) vertices from the position maps, or those given."""
        if self._weights is not None:
            assert self._inputs.positions is not None
            return self._weights(self._imager.sample(self._inputs.positions[frames].to(self._device)))
        assert self._inputs.initial is not None
        return self._inputs.initial[frames].to(self._device)

    def _target(self, frames: slice) -> torch.Tensor | None:
        """(T, P, 3) unit normals at the covered pixels. A network's average of normals is shorter than 1."""
        if self._inputs.normals is None:
            return None
        flat = self._inputs.normals[frames].flatten(1, 3).to(self._device)
        return safe_normalize(flat[:, self._places.to(self._device)])

    def _inside(self, vertices: torch.Tensor) -> np.ndarray:
        assert self._sdfs is not None
        return (self._sdfs[1].query(vertices).distance < 0).float().mean(-1).cpu().numpy()


def covered_pixels(imager: TemplateImager) -> tuple[SparseProduct, torch.Tensor]:
    """The interpolation B without its empty rows, and where the P covered pixels are among all: (P,) int64."""
    places = np.flatnonzero(imager.raster.mask)
    corners = imager.mesh.faces[imager.raster.face_id.reshape(-1)[places]]
    weights = imager.raster.barycentric.reshape(-1, 3)[places]
    rows = np.repeat(np.arange(len(places)), 3)
    shape = (len(places), len(imager.mesh.vertices))
    return SparseProduct(rows, corners.ravel(), weights.ravel(), shape), torch.from_numpy(places)


def _array(vertices: torch.Tensor) -> np.ndarray:
    return np.ascontiguousarray(vertices.cpu().numpy(), np.float32)


def _report(pieces: list[_Piece], seconds: float) -> dict[str, Any]:
    """Means over all frames."""
    terms: dict[str, dict[str, dict[str, float]]] = {}
    for stage in pieces[0].stages:
        terms[stage] = {
            when: {
                name: float(torch.cat([getattr(piece.stages[stage], when)[name] for piece in pieces]).mean())
                for name in getattr(pieces[0].stages[stage], when)
            }
            for when in ("start", "end")
        }
    report: dict[str, Any] = {"frames": sum(len(piece.vertices) for piece in pieces), "terms": terms}
    inside = [piece.inside for piece in pieces if piece.inside is not None]
    if inside:
        before, after = (100 * float(np.concatenate(part).mean()) for part in zip(*inside, strict=True))
        report["penetration_percent"] = {"before_clearance": before, "after": after}
    return report | {"seconds": seconds, "seconds_per_frame": seconds / report["frames"]}
