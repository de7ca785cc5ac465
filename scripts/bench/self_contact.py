#!/usr/bin/env python
"""What `self_contact` does to cloth that passes through itself: ten frames of each of some clips of the sample data.

The scenes are made as in scripts/bench/fusion_scenes.py: "predicted" is what configs/pretrained predicts for the
T-shirt, "disturbed" has positions blurred and displaced by smooth noise of 8 mm a component, and exact normals. Maps
of 128 x 128 pixels, front and back. `bend` and `punch` are test clips; constants were chosen on the others.

  truth_percent     the garment's edges that pass through its own faces, in per cent, mean of the frames: the truth's,
  without_percent   fused without `self_contact`,
  with_percent      and with it
  *_rmse_mm         mean distance of the vertices from the truth
  *_longest_edge    the longest edge of any frame, as a multiple of its length in the template
  *_cpu_ms          of a frame, processor time of a whole call of `fuse` by one thread, set-up included; both take turns
  cpu_ratio         with / without
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

import numpy as np
import torch

# This folder's own fusion.py and render.py must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fusion import FusionConfig, FusionResult
from fusion.obstacles import self_crossing_fractions
from scripts.bench import fusion_scenes as scenes
from scripts.bench.fusion import Scene, rmse_mm, solver_config
from scripts.bench.fusion_quality import longest_edge
from scripts.bench.measuring import Results, command

EVERY, ROUNDS = 6, 3  # frame of a clip; timed calls of either kind
PREDICTED = ("kick_s107", "squat_s105", scenes.BEND, scenes.PUNCH)
DISTURBED = (
    ("tshirt", "squat_s105"),
    ("dress", "walk_s104"),
    ("skirt", "walk_s104"),
    ("trousers", "kick_s107"),
    ("dress", scenes.BEND),
    ("trousers", scenes.BEND),
)


def measure(quick: bool) -> Results:
    """A section a scene."""
    frames, rounds = (slice(1), 1) if quick else (slice(None), ROUNDS)
    made = scenes_of(frames)
    return {name: compared(make(), rounds) for name, make in list(made.items())[: 1 if quick else None]}


def scenes_of(frames: slice) -> Mapping[str, Callable[[], Scene]]:
    """What makes each scene, by name: some of every sixth frame of a clip."""

    def disturbed(garment: str, name: str) -> Scene:
        clip = scenes.sample_clip(garment, name, slice(None, None, EVERY)).slice(frames)
        return scenes.disturbed(scenes.true_scene(clip))

    predicted = {
        f"tshirt_{name}_predicted": lambda name=name: scenes.predicted_scene(name, EVERY, frames)
        for name in PREDICTED
    }
    return predicted | {
        f"{garment}_{name}_disturbed": lambda garment=garment, name=name: disturbed(garment, name)
        for garment, name in DISTURBED
    }


def compared(scene: Scene, rounds: int) -> dict[str, float]:
    """One scene fused without and with contact of the garment with itself."""
    config = solver_config("local_global")
    kinds = {"without": config, "with": config.model_copy(update={"self_contact": True})}
    results = {kind: scene.fuse(one) for kind, one in kinds.items()}  # what compiles is called here
    seconds: dict[str, list[float]] = {kind: [] for kind in kinds}
    for _ in range(rounds):
        for kind, one in kinds.items():
            seconds[kind].append(_busy(scene, one))
    found = {"truth_percent": _percent(scene, scene.truth)}
    for kind, result in results.items():
        found |= _told(kind, result, scene)
        found[f"{kind}_cpu_ms"] = 1000 * median(seconds[kind]) / len(scene.truth)
    found["cpu_ratio"] = found["with_cpu_ms"] / found["without_cpu_ms"]
    return found


def _told(kind: str, result: FusionResult, scene: Scene) -> dict[str, float]:
    return {
        f"{kind}_percent": _percent(scene, result.vertices),
        f"{kind}_rmse_mm": rmse_mm(result.vertices, scene),
        f"{kind}_longest_edge": longest_edge(result.vertices, scene),
    }


def _percent(scene: Scene, vertices: np.ndarray) -> float:
    return 100 * float(self_crossing_fractions(vertices, scene.imager.mesh.faces).mean())


def _busy(scene: Scene, config: FusionConfig) -> float:
    torch.set_num_threads(1)
    started = time.process_time()
    scene.fuse(config)
    return time.process_time() - started


if __name__ == "__main__":
    command(__doc__, measure)
