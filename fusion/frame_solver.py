"""All that is constant over the frames of a fusion, and the solution of a batch of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import torch

from fusion.config import FusionConfig
from fusion.crossing_report import ClothAndBody, CrossingFractions, CrossingReport
from fusion.grown_maps import GrownMaps
from fusion.initialise import InitialWeights, Readings
from fusion.input_checks import rest_mesh
from fusion.inputs import FusionInputs
from fusion.losses import anchor_weights
from fusion.obstacles.cached import CachedObstacle, make_obstacle, pose
from fusion.obstacles.clearance import lift_clear
from fusion.obstacles.untangling import Untangler
from fusion.parallel import in_order
from fusion.report import Stopwatch
from fusion.robust.automatic_confidence import AutomaticConfidence, JudgedMaps
from fusion.solvers.adam import AdamSolver
from fusion.solvers.local_global import LocalGlobalSolver
from fusion.solvers.pixel_faces import PixelFaces
from fusion.stages import BatchResult, Solver, SolverResult, StageProblem, any_steps
from fusion.topology import Topology
from render.maps.imager import TemplateImager
from render.mesh.mesh import check_finite
from render.mesh.normals import safe_normalize


class FrameSolver:
    """From maps to vertices for one template, batch by batch.

    Args:
        imager: of the template.
        inputs: of any frames, checked: what is given at all, and the rest shape, whose geometry the losses and the
            solver know.
        config: hyper-parameters.
        device: computes.
        threads: batches that are solved at the same time.
        weighted: whether any pixel's confidence is not 1; without, confidences are not looked at.
        grown: which pixels of the position maps have grown from others, and are not judged; None: none.

    Raises:
        InputError: a rest shape that does not fit the template, or a template that no view sees.
    """

    def __init__(
        self,
        imager: TemplateImager,
        inputs: FusionInputs,
        config: FusionConfig,
        device: torch.device,
        *,
        threads: int,
        weighted: bool,
        grown: GrownMaps | None = None,
    ) -> None:
        self._grown = grown
        self._config, self._device, self._threads, self._weighted = config, device, threads, weighted
        shape = rest_mesh(inputs.rest, imager.mesh)
        self._topology = Topology(shape)
        self._weights = InitialWeights(imager, shape) if inputs.maps.positions is not None else None
        self._automatic: AutomaticConfidence | None = None
        if config.automatic_confidence and inputs.maps.positions is not None:
            self._automatic = AutomaticConfidence(imager, shape, device)
        seen = imager.visible.any(axis=0) if self._weights is None else self._weights.seen
        self._seen = torch.from_numpy(seen).to(device)
        self._pixel_faces = PixelFaces.of(imager.raster, self._topology)
        self._fixed: torch.Tensor | None = None
        if inputs.pins is not None:
            self._fixed = torch.zeros(len(imager.mesh.vertices), dtype=torch.bool, device=device)
            self._fixed[inputs.pins.indices] = True
        # An obstacle stands in one pose at a time: each thread takes one while it works.
        self._obstacles: SimpleQueue[CachedObstacle | None] = SimpleQueue()
        for _ in range(threads + bool(config.smooth_time_s)):  # one for `settled`, beside the threads
            self._obstacles.put(make_obstacle(inputs, config, device, self._topology))
        self._crossings: SimpleQueue[CrossingReport] = SimpleQueue()  # as the obstacles
        for _ in range(threads):
            self._crossings.put(CrossingReport(imager.mesh, device))
        self._untangler = Untangler(self._topology, self._fixed, device) if config.self_contact else None
        self._solver = self._make_solver(with_normals=inputs.maps.normals is not None)
        self._changes: dict[str, torch.Tensor] = {}  # by stage, (1, N, 3): what it moved in the frame before

    def solve_all(self, batches: Iterable[FusionInputs], watch: Stopwatch) -> Iterator[BatchResult]:
        """All batches solved, in their order; over several threads where that helps.

        Args:
            batches: checked; no more are asked for than keep the threads busy.
            watch: is told how long each stage takes.

        Raises:
            InputError: vertices that are no longer finite, a body turned inside out, or what `batches` raises.
        """
        return in_order(lambda batch: self.solve(batch, watch), batches, threads=self._threads)

    def solve(self, batch: FusionInputs, watch: Stopwatch) -> BatchResult:
        """Both stages and the clean-up of some frames.

        Args:
            batch: checked.
            watch: is told how long each stage takes.

        Raises:
            InputError: vertices that are no longer finite, or a body turned inside out.
        """
        obstacle = self._obstacles.get()
        try:
            return self._solved(batch, watch, obstacle)
        finally:
            self._obstacles.put(obstacle)

    def _solved(self, inputs: FusionInputs, watch: Stopwatch, obstacle: CachedObstacle | None) -> BatchResult:
        stages: dict[str, SolverResult] = {}
        config = self._config
        with watch.stage("start"):
            judged = self._judged(inputs)
            readings = self._readings(inputs, judged)
            target, confidence = self._target(inputs)
            if obstacle is not None:
                pose(obstacle, inputs)
        vertices = initial = readings.vertices
        if inputs.maps.positions is not None and any_steps(config, "edge"):
            vertex_weights = anchor_weights(
                self._seen if readings.confidence is None else readings.seen, readings.confidence
            )
            problem = StageProblem(
                start=self._start("edge", initial), anchor=initial, vertex_weights=vertex_weights
            )
            with watch.stage("edge"):
                stages["edge"] = self._solver.edge_stage(problem)
            vertices = self._result("edge", initial, stages["edge"])
        if any_steps(config, "normal") and (target is not None or obstacle is not None):
            problem = StageProblem(
                start=self._start("normal", vertices),
                anchor=vertices,
                target=target,
                confidence=confidence,
                obstacle=obstacle,
                surface=None if obstacle is None else obstacle.surface,
            )
            with watch.stage("normal"):
                stages["normal"] = self._solver.normal_stage(problem)
            vertices = self._result("normal", vertices, stages["normal"])
        cleared = None
        if obstacle is not None:
            with watch.stage("clearance"):
                cleared = self._cleared(vertices, obstacle)
                vertices = cleared.after[0]
        if self._untangler is not None:
            with watch.stage("self_contact"):
                vertices, again = self._untangled(self._untangler, vertices, obstacle)
                if cleared is not None and again is not None:
                    cleared = replace(cleared, after=again.after)
        unseen = 1 - readings.seen.float().mean(-1).cpu().numpy()
        solved = _array(vertices)
        check_finite(solved, "fuse: the result", first=inputs.first_frame)
        with watch.stage("crossings"):
            crossing = self._crossing_fractions(vertices, inputs, cleared)
        findings = None if judged is None else judged.findings
        inside = None if cleared is None else cleared.inside()
        return BatchResult(solved, _array(initial), stages, unseen, inside, crossing, findings)

    def _crossing_fractions(
        self, vertices: torch.Tensor, inputs: FusionInputs, cleared: ClothAndBody | None
    ) -> CrossingFractions:
        report = self._crossings.get()
        try:
            body = cleared if inputs.body is not None else None
            return report.fractions(vertices, inputs.first_frame, body)
        finally:
            self._crossings.put(report)

    def settled(
        self, inputs: FusionInputs, before: np.ndarray, smooth: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Smoothed vertices with pins in place, outside of the obstacles and, where that is wanted, of the garment
        itself, as `fusion.smoothing.Settle` says."""
        vertices = torch.from_numpy(smooth).to(self._device)
        if self._fixed is not None:
            vertices[:, self._fixed] = torch.from_numpy(before).to(vertices)[:, self._fixed]
        obstacle = self._obstacles.get()
        try:
            cleared = None
            if obstacle is not None:
                pose(obstacle, inputs)
                cleared = self._cleared(vertices, obstacle)
                vertices = cleared.after[0]
            if self._untangler is not None:  # means of frames may cross though no frame does
                vertices, cleared = self._untangled(self._untangler, vertices, obstacle)
            return _array(vertices), None if cleared is None else cleared.inside()[1]
        finally:
            self._obstacles.put(obstacle)

    def _untangled(
        self, untangler: Untangler, vertices: torch.Tensor, obstacle: CachedObstacle | None
    ) -> tuple[torch.Tensor, ClothAndBody | None]:
        """The garment out of itself, and out of the obstacle once more: the vertices, and that clean-up."""
        vertices = untangler.untangled(vertices, obstacle, self._config.clearance_m)
        if obstacle is None:
            return vertices, None
        cleared = self._cleared(vertices, obstacle)
        return cleared.after[0], cleared

    def _make_solver(self, *, with_normals: bool) -> Solver:
        config = self._config
        if config.solver == "adam":
            pixels = self._pixel_faces.product(self._topology.n_vertices) if with_normals else None
            return AdamSolver(self._topology, config, pixels=pixels, fixed=self._fixed)
        return LocalGlobalSolver(
            self._topology,
            config,
            seen=self._seen,
            pixel_faces=self._pixel_faces,
            device=self._device,
            fixed=self._fixed,
        )

    def _judged(self, inputs: FusionInputs) -> JudgedMaps | None:
        """The position maps and what their pixels count, by themselves and as given; None without position maps."""
        if inputs.maps.positions is None:
            return None
        positions, confidence = inputs.maps.positions.to(self._device), self._confidence(inputs)
        if self._automatic is None:
            return JudgedMaps(positions, confidence)
        if self._grown is not None:
            return self._grown.judged(self._automatic, positions, confidence)
        return self._automatic.judge(positions, confidence)

    def _readings(self, inputs: FusionInputs, judged: JudgedMaps | None) -> Readings:
        """Vertices from the position maps, or those given; pinned ones where they are wanted."""
        if self._weights is not None and judged is not None:
            readings = self._weights.read(judged.positions, judged.confidence)
        else:
            assert inputs.initial is not None
            vertices = inputs.initial.to(self._device)
            readings = Readings(vertices, self._seen.expand(len(vertices), -1))
        if inputs.pins is None or inputs.pins.positions is None:
            return readings
        pinned = readings.vertices.clone()
        pinned[:, inputs.pins.indices] = inputs.pins.positions.to(pinned)
        return replace(readings, vertices=pinned)

    def _confidence(self, inputs: FusionInputs) -> torch.Tensor | None:
        """(T, S, H, W); None where all count alike."""
        if not self._weighted or inputs.maps.confidence is None:
            return None
        return inputs.maps.confidence.to(self._device)

    def _target(self, inputs: FusionInputs) -> tuple[torch.Tensor | None, torch.Tensor | None]:
        """(T, P, 3) unit normals at the covered pixels, and their confidence (T, P).

        A network's average of normals is shorter than 1.
        """
        places, normals = self._pixel_faces.places, inputs.maps.normals
        if normals is None:
            return None, None
        target = safe_normalize(normals.flatten(1, 3).index_select(1, places).to(self._device))
        confidence = self._confidence(inputs)
        return target, None if confidence is None else confidence.flatten(1)[:, places]

    def _start(self, stage: str, vertices: torch.Tensor) -> torch.Tensor:
        """Where to start: `vertices`, moved as in the frame before for a warm start."""
        change = self._changes.get(stage)
        return vertices if change is None else vertices + change

    def _result(self, stage: str, before: torch.Tensor, solved: SolverResult) -> torch.Tensor:
        """The stage's result, layers that no view sees against the cloth next to them again.

        For a warm start, what the stage changed is kept for the next frame.
        """
        if self._config.warm_start:
            self._changes[stage] = solved.vertices - before
        if self._weights is None:
            return solved.vertices
        vertices = self._weights.put_back(solved.vertices)
        return (
            vertices if self._fixed is None else torch.where(self._fixed[:, None], solved.vertices, vertices)
        )

    def _cleared(self, vertices: torch.Tensor, obstacle: CachedObstacle) -> ClothAndBody:
        """The clean-up."""
        assert obstacle.surface is not None
        before = obstacle.tracker.near(vertices, 0.0).distance
        cleared = lift_clear(
            vertices,
            obstacle,
            self._topology,
            clearance_m=self._config.clearance_m,
            rounds=self._config.clearance_rounds,
            fixed=self._fixed,
            surface=obstacle.surface,
        )
        return ClothAndBody(obstacle.surface, (vertices, before), (cleared.vertices, cleared.distance))


def _array(vertices: torch.Tensor) -> np.ndarray:
    return np.ascontiguousarray(vertices.cpu().numpy(), np.float32)
