"""What the demo compares: test clips, what every method makes of them, and how far that is from the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames
from imgtransfer.pipeline.deform import Deformation
from render import InputError

TRAINED, PRETRAINED = "trained here", "pretrained"  # the two models
METHODS = {
    "lbs": "the template skinned with the weights of the nearest body vertices",
    "position_only": "vertices read from the position maps of the model that this demo trained",
    "fused": "the same model's position and normal maps, fused",
    "fused_pretrained": "the fusion of the maps of a checkpoint that comes with the project, made from more clips: "
    "configs/pretrained for the T-shirt, configs/general for other garments",
}
Metrics = dict[str, dict[str, float]]  # by method, what `evaluate_clip` returns


@dataclass(frozen=True, eq=False)
class Case:
    """One test clip with what every method makes of it.

    Args:
        truth: the simulated clip.
        vertices: by method, (T, N, 3) float32, metres, world.
        maps: by model (`TRAINED`, `PRETRAINED`), its prediction.
    """

    truth: Clip
    vertices: dict[str, np.ndarray] = field(default_factory=dict)
    maps: dict[str, Deformation] = field(default_factory=dict)

    @property
    def methods(self) -> list[str]:
        """Those that there are vertices of yet, in the order of `METHODS`."""
        return [method for method in METHODS if method in self.vertices]

    @property
    def truth_vertices(self) -> np.ndarray:
        """(T, N, 3) the simulated garment; InputError for a clip that has only a body."""
        if self.truth.garment is None:
            raise InputError(f"{self.truth.name}: has no garment_vertices to compare with")
        return self.truth.garment.vertices

    def error_mm(self, method: str) -> np.ndarray:
        """(T, N) distance of each vertex to the truth, millimetres."""
        return 1e3 * np.linalg.norm(self.vertices[method] - self.truth_vertices, axis=-1)

    def metrics(self) -> Metrics:
        """Of every method that there is yet."""
        clip = self.truth
        return {
            method: evaluate_clip(
                self.vertices[method],
                self.truth_vertices,
                clip.template.faces,
                clip.body.vertices,
                clip.body.faces,
            )
            for method in self.methods
        }


def measured(cases: Sequence[Case]) -> tuple[dict[str, Metrics], Metrics]:
    """By clip, and the means over all frames."""
    by_clip = {case.truth.name: case.metrics() for case in cases}
    overall = {}
    for method in cases[0].methods:
        pairs = [(by_clip[case.truth.name][method], case.truth.n_frames) for case in cases]
        overall[method] = mean_over_frames(pairs)
    return by_clip, overall
