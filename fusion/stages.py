"""What a solver is given and what it returns: the two stages of section 3.3 of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from fusion.config import FusionConfig
from fusion.crossing_report import CrossingFractions
from fusion.obstacles.sdf import Obstacle
from fusion.obstacles.surface_contact import SurfaceContact
from fusion.robust.map_fault import MapFindings

CENTIMETRES = 100.0  # in a metre; the unit of lengths that the weights are made for
Terms = dict[str, torch.Tensor]  # by name, one value a frame: (..., T)


@dataclass(frozen=True, kw_only=True, eq=False)
class StageProblem:
    """T frames of one stage.

    Args:
        start: (T, N, 3) metres, where to start.
        anchor: (T, N, 3) metres, where displacements are measured from.
        vertex_weights: (T, N) or (N,), what each vertex's displacement counts; None: 1 / N each.
        target: (T, P, 3) unit normals at the P covered pixels, ordered as `PixelFaces.places`.
        confidence: (T, P), what each pixel counts; None: 1 each.
        obstacle: the T posed bodies, or whatever vertices must stay outside of.
        surface: finds where the cloth between vertices is in it; None: only vertices are kept out.
    """

    start: torch.Tensor
    anchor: torch.Tensor
    vertex_weights: torch.Tensor | None = None
    target: torch.Tensor | None = None
    confidence: torch.Tensor | None = None
    obstacle: Obstacle | None = None
    surface: SurfaceContact | None = None


@dataclass(frozen=True, eq=False)
class SolverResult:
    """What a solver returns.

    Args:
        vertices: (T, N, 3) metres.
        history: the terms (K, T), unweighted, in metres: before the first, and after each of K - 1 steps.
        iterations: (T,) int64, steps taken.
    """

    vertices: torch.Tensor
    history: Terms
    iterations: torch.Tensor

    def at(self, step: int) -> Terms:
        """The terms (T,) after so many steps, -1 for the last."""
        return {name: values[step] for name, values in self.history.items()}


@dataclass(frozen=True, eq=False)
class BatchResult:
    """One batch of frames, solved.

    Args:
        vertices, initial: (T, N, 3) float32, metres.
        stages: what the solver returned, by stage.
        unseen: (T,) fraction of the vertices that were not read from the maps.
        inside: (T,) fractions of the vertices below an obstacle's surface before and after the clean-up.
        crossing: edges that pass through the body or the garment itself.
        findings: what was wrong with the position maps; None where nothing was looked for.
    """

    vertices: np.ndarray
    initial: np.ndarray
    stages: dict[str, SolverResult]
    unseen: np.ndarray
    inside: tuple[np.ndarray, np.ndarray] | None
    crossing: CrossingFractions
    findings: MapFindings | None = None


class Solver(Protocol):
    """Either solver, made once for a template."""

    def edge_stage(self, problem: StageProblem) -> SolverResult:
        """First stage: edge lengths and displacements."""
        ...

    def normal_stage(self, problem: StageProblem) -> SolverResult:
        """Second stage, equation 8; the terms whose input is missing are left out."""
        ...


def edge_weights(config: FusionConfig) -> dict[str, float]:
    """Weights of the first stage by term, for terms in metres."""
    return {
        "edge_length_m2": CENTIMETRES**2,
        "displacement_m2": config.weight_displacement * CENTIMETRES**2,
    }


def normal_weights(config: FusionConfig) -> dict[str, float]:
    """Weights of the second stage by term, for terms in metres."""
    return {
        "normal_rendering": 1.0,
        "normal_consistency": config.weight_consistency,
        "edge_length_m2": config.weight_edge * CENTIMETRES**2,
        "displacement_m2": config.weight_displacement * CENTIMETRES**2,
        "collision_m": config.weight_collision * CENTIMETRES,
    }


def total(terms: Terms, weights: Mapping[str, float]) -> torch.Tensor:
    """The weighted sum of the terms (..., T), which is what a stage minimises.

    Args:
        terms: unweighted, lengths in metres.
        weights: of `edge_weights` or `normal_weights`; of every term at least.
    """
    return torch.stack([weights[name] * value for name, value in terms.items()]).sum(0)


def any_steps(config: FusionConfig, stage: str) -> bool:
    """Whether the chosen solver does anything in `stage`."""
    steps = {
        ("adam", "edge"): config.edge_steps,
        ("adam", "normal"): config.normal_steps,
        ("local_global", "edge"): config.edge_iterations,
        ("local_global", "normal"): config.normal_iterations,
    }
    return steps[config.solver, stage] > 0
