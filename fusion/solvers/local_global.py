"""The default solver: one prefactorised system per template and stage, and quasi-Newton steps around it."""

from __future__ import annotations

from threading import Lock

import numpy as np
import scipy.sparse
import torch

from fusion.config import FusionConfig
from fusion.solvers.contact import Contact
from fusion.solvers.energy import TERMS, Energy
from fusion.solvers.pixel_faces import PixelFaces, gradient_laplacian
from fusion.solvers.quasi_newton import descend
from fusion.solvers.system import System
from fusion.stages import SolverResult, StageProblem, edge_weights, normal_weights
from fusion.topology import Topology

# The system estimates the Hessian of every frame at once, so it can only be roughly right; found by trial on simulated
# garments. Where there are only so many steps, results depend on these numbers, too: what knows less of what holds the
# cloth in place gets as low in fewer steps, and may drift away from the maps.
# Fraction of the edge term's Hessian if edges resisted in all directions alike: they do in one of three.
_EDGES = 0.3
# Distance between rendered and target normals around which |Bn - t| is replaced by a parabola.
_RESIDUAL = 0.1
# Stiffness against moving as a whole in the second stage, as a displacement weight in units of the edge term's: the
# body and the normals hold the cloth in ways of which the system knows nothing.
_HOLD = 0.1
# Part of a matrix's mean diagonal that is added where nothing else holds a vertex.
_FLOOR = 1e-6


class LocalGlobalSolver:
    """Both stages by `descend`, on Warp and a sparse Cholesky factor; CPU and CUDA, several threads at once.

    Args:
        topology: of the template.
        config: weights and schedule.
        seen: (N,) bool, vertices that have readings.
        pixel_faces: the covered pixels, by face.
        device, dtype: of the problems; float32 or float64.
        fixed: (N,) bool, vertices that stay where they start; None holds none.
    """

    def __init__(
        self,
        topology: Topology,
        config: FusionConfig,
        *,
        seen: torch.Tensor,
        pixel_faces: PixelFaces,
        device: torch.device,
        dtype: torch.dtype = torch.float32,
        fixed: torch.Tensor | None = None,
    ) -> None:
        self._topology, self._config, self._pixel_faces = topology, config, pixel_faces
        self._fixed = None if fixed is None else fixed.cpu().numpy()
        self._loose = None if fixed is None else (~fixed).to(device)
        self._device_and_dtype = device, dtype
        self._edge_weights, self._normal_weights = edge_weights(config), normal_weights(config)
        self._edge_system = self._system(self._edge_hessian(seen.cpu().numpy()))
        self._normal_system: System | None = None
        self._lock = Lock()

    def edge_stage(self, problem: StageProblem) -> SolverResult:
        """First stage: L_e + λ_rv L_rv, the displacement over visible vertices only."""
        limits = self._config.edge_iterations, self._config.edge_tolerance
        return self._descend(problem, self._edge_weights, self._edge_system, limits)

    def normal_stage(self, problem: StageProblem) -> SolverResult:
        """Second stage, equation 8; vertices are held outside of the obstacle (see `descend`)."""
        config, contact = self._config, None
        with self._lock:  # of several threads, the first one makes it
            if self._normal_system is None:
                self._normal_system = self._system(self._normal_hessian())
        if problem.obstacle is not None and config.weight_collision:
            contact = Contact(
                problem.obstacle,
                problem.anchor,
                margin_m=config.margin_m,
                every_steps=config.sdf_every_iterations,
                surface=problem.surface,
                loose=self._loose,
                topology=self._topology,
            )
        limits = config.normal_iterations, config.normal_tolerance
        return self._descend(problem, self._normal_weights, self._normal_system, limits, contact)

    def _descend(
        self,
        problem: StageProblem,
        weights: dict[str, float],
        system: System,
        limits: tuple[int, float],
        contact: Contact | None = None,
    ) -> SolverResult:
        """Within at most so many steps, or to a tolerance."""
        vertex_weights = problem.vertex_weights
        if vertex_weights is None:
            vertex_weights = problem.anchor.new_full(
                (1, problem.anchor.shape[1]), 1 / problem.anchor.shape[1]
            )
        energy = Energy(
            self._topology,
            weights,
            problem.anchor,
            vertex_weights if vertex_weights.ndim == 2 else vertex_weights[None],
            pixel_faces=None if problem.target is None else self._pixel_faces,
            target=problem.target,
            confidence=problem.confidence,
        )
        descent = descend(
            energy,
            system,
            problem.start,
            steps=limits[0],
            tolerance=limits[1],
            loose=self._loose,
            contact=contact,
        )
        history = {
            name: values
            for name, values in zip(TERMS, descent.history.unbind(-1), strict=True)
            if name in weights and (name != "normal_rendering" or problem.target is not None)
        }
        if descent.depths is not None:
            history["collision_m"] = descent.depths
        return SolverResult(descent.vertices, history, descent.iterations)

    def _edge_hessian(self, seen: np.ndarray) -> scipy.sparse.csr_matrix:
        """Of the first stage."""
        weights = self._edge_weights
        anchored = 2 * weights["displacement_m2"] * seen / max(seen.sum(), 1)
        return self._edge_part(_EDGES * weights["edge_length_m2"]) + scipy.sparse.diags(anchored)

    def _normal_hessian(self) -> scipy.sparse.csr_matrix:
        """Of the second stage: a vertex normal changes as the gradient of the displacement along it."""
        weights, topology, pixel_faces = self._normal_weights, self._topology, self._pixel_faces
        fraction = pixel_faces.pixels_per_face() / max(len(pixel_faces.places), 1)
        bend = gradient_laplacian(topology.rest_vertices, pixel_faces.faces, fraction)
        anchored = 2 * (weights["displacement_m2"] + _HOLD * weights["edge_length_m2"])
        return (
            self._edge_part(_EDGES * weights["edge_length_m2"])
            + (weights["normal_rendering"] / _RESIDUAL) * bend
            + scipy.sparse.diags(np.full(topology.n_vertices, anchored / topology.n_vertices))
        )

    def _edge_part(self, weight: float) -> scipy.sparse.csr_matrix:
        """The edge term's Hessian if every edge resisted in all directions alike."""
        first, second = self._topology.edges.T
        n, pull = self._topology.n_vertices, np.full(len(first), -2 * weight / max(len(first), 1))
        rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
        matrix = scipy.sparse.csr_matrix((np.tile(pull, 2), (rows, columns)), shape=(n, n))
        return matrix - scipy.sparse.diags(np.asarray(matrix.sum(1)).ravel())

    def _system(self, hessian: scipy.sparse.csr_matrix) -> System:
        """Systemised without the rows and columns of fixed vertices."""
        diagonal = hessian.diagonal()
        floor = _FLOOR * max(diagonal.mean(), np.finfo(np.float32).tiny)
        matrix = hessian + scipy.sparse.diags(np.full(len(diagonal), floor))
        if self._fixed is not None:
            loose = scipy.sparse.diags((~self._fixed).astype(np.float64))
            pinned = scipy.sparse.diags(self._fixed * matrix.diagonal())
            matrix = loose @ matrix @ loose + pinned
        return System(matrix, *self._device_and_dtype)
