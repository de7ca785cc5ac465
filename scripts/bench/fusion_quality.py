#!/usr/bin/env python
"""How good a fusion is on clips of cloth: both solvers on six scenes of the sample data, and on maps with faults.

The scenes (scripts/bench/fusion_scenes.py) have maps of 128 x 128 pixels, front and back, in the canonical frame, and
their bodies. Two are what configs/pretrained predicts for the T-shirt's test clips, every sixth frame; four are the
bend clip of each garment, every twelfth frame, with positions blurred and displaced by smooth noise of 8 mm a
component and exact normals. One process computes, one solver after the other.

  *_objective       weighted sum of the second stage's terms at its end, before the clean-up, with the configuration's
                    own weights, collision included; objective_ratio is local_global / adam
  *_longest_edge    the longest edge of any frame, as a multiple of its length in the template
  *_rmse_mm         mean distance of the vertices from the truth; rmse_ratio is local_global / adam
  adam_without_offset_rmse_mm  of predictions, adam without the margin that the model knows of, as is its default;
                    everywhere else both solvers have it
  *_crossing_edges  edges of garment and body that pass through a face of the other, mean over the frames;
                    *_crossing_most is of the worst frame
  *_normal_degrees  mean angle between the vertex normals and the true ones
  *_steps_STAGE     steps taken, mean over the frames
  *_cpu_seconds     a frame, seconds that the process kept cores busy, one thread, whole calls of `fuse` for 16 frames
                    (the scene's frames again and again) with their bodies, set-up included; cpu_speedup is
                    adam / local_global
  speedup           the same of seconds on the clock, local_global with two threads; adam, the reference, has one

Faults and their absence, on every eighth frame of the T-shirt's bend clip, true maps otherwise:

  clean             true maps
  outliers          one covered pixel in ten displaced by Gaussian noise of 20 cm a component
  sleeve_off        one sleeve displaced by 10 cm in both views
  unseen            true maps of every garment's bend clip, every twelfth frame: mean error of the vertices that no view
                    sees, as read from the maps (GARMENT_mm) and after everything (GARMENT_fused_mm); the same of the
                    template itself (GARMENT_rest_mm, GARMENT_rest_fused_mm). local_global
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
from fusion.obstacles import body_crossing_fractions
from scripts.bench import fusion_scenes as scenes
from scripts.bench.fusion import SOLVERS, Scene, losses, normal_degrees, rmse_mm, solver_config
from scripts.bench.measuring import Results, command

FRAMES, THREADS = 16, 2  # of a timed call; of the speed-up by the clock
QUICK = ("predicted_bend", "tshirt")


def measure(quick: bool) -> Results:
    """A section a scene, and one a fault."""
    size, frames, steps, calls = (48, slice(1), 2, 1) if quick else (scenes.SIZE, slice(None), 100, FRAMES)
    results: Results = {}
    for name, made in six_scenes(frames, size).items():
        if quick and name not in QUICK:
            continue
        scene = made()
        results[name] = quality(scene, steps) | speed(scene, steps, calls)
    for name, scene in faults(frames, size).items():
        results[name] = quality(scene, steps)
    results["unseen"] = unseen(("tshirt",) if quick else scenes.GARMENTS, frames, size)
    return results


def six_scenes(frames: slice, size: int) -> Mapping[str, Callable[[], Scene]]:
    """What makes each scene, by name: some of its frames, maps of `size` pixels where they are not predicted."""
    predicted = {
        f"predicted_{name}": lambda clip=clip: scenes.predicted_scene(clip, 6, frames)
        for name, clip in (("bend", scenes.BEND), ("punch", scenes.PUNCH))
    }
    disturbed = {
        garment: lambda garment=garment: scenes.disturbed(_bent(garment, frames, size))
        for garment in scenes.GARMENTS
    }
    return predicted | disturbed


def faults(frames: slice, size: int) -> Mapping[str, Scene]:
    """The T-shirt's true maps, and the same with faults."""
    clip = scenes.sample_clip("tshirt", scenes.BEND, slice(None, None, 8)).slice(frames)
    clean = scenes.true_scene(clip, size=size)
    return {
        "clean": clean,
        "outliers": scenes.with_outliers(clean),
        "sleeve_off": scenes.with_sleeve_off(clean),
    }


def quality(scene: Scene, steps: int) -> dict[str, float]:
    """How near to truth and minimum both solvers end; `steps` for both stages of adam."""
    found: dict[str, float] = {"vertices": scene.truth.shape[1], "frames": len(scene.truth)}
    for name in SOLVERS:
        config = same_problem(scene, solver_config(name, steps=steps))
        result = scene.fuse(config)
        found |= {
            f"{name}_objective": losses(result, config)["normal"],
            f"{name}_longest_edge": longest_edge(result.vertices, scene),
            f"{name}_rmse_mm": rmse_mm(result.vertices, scene),
            f"{name}_normal_degrees": normal_degrees(result.vertices, scene),
        }
        crossing = crossing_edges(result.vertices, scene)
        found |= {f"{name}_crossing_edges": float(crossing.mean())}
        found |= {f"{name}_crossing_most": float(crossing.max())}
        found |= {f"{name}_steps_{stage}": count for stage, count in result.report["iterations"].items()}
    for key, measured in (("objective_ratio", "objective"), ("rmse_ratio", "rmse_mm")):
        found[key] = found[f"local_global_{measured}"] / found[f"adam_{measured}"]
    if scene.contact_offset_m is not None:
        found["adam_without_offset_rmse_mm"] = rmse_mm(
            scene.fuse(solver_config("adam", steps=steps)).vertices, scene
        )
    return found


def same_problem(scene: Scene, config: FusionConfig) -> FusionConfig:
    """With the margin of the scene's contact offset for either solver: `adam` takes none by itself, and then minimises
    another sum."""
    return config.model_copy(update={"collision_margin_m": scene.contact_offset_m or 0.0})


def speed(scene: Scene, steps: int, frames: int) -> dict[str, float]:
    """Seconds of calls of so many frames."""
    many = scene.repeated(frames)
    seconds: dict[str, list[float]] = {}

    def timed(name: str, solver: str, threads: int) -> None:
        torch.set_num_threads(threads)
        started, started_cpu = time.perf_counter(), time.process_time()
        many.fuse(same_problem(scene, solver_config(solver, steps=steps)))
        seconds.setdefault(name, []).append(time.perf_counter() - started)
        seconds.setdefault(f"{name}_cpu", []).append(time.process_time() - started_cpu)
        torch.set_num_threads(1)

    # What compiles and allocates has been called by `quality`. The quick solver several times about the slow one.
    for name in ("local_global", "threaded", "adam", "local_global", "threaded"):
        timed(name, "adam" if name == "adam" else "local_global", THREADS if name == "threaded" else 1)
    spent = {name: median(values) / frames for name, values in seconds.items()}
    return {
        "local_global_cpu_seconds": spent["local_global_cpu"],
        "adam_cpu_seconds": spent["adam_cpu"],
        "cpu_speedup": spent["adam_cpu"] / spent["local_global_cpu"],
        "speedup": spent["adam"] / spent["threaded"],
    }


def longest_edge(vertices: np.ndarray, scene: Scene) -> float:
    """The longest edge of vertices (T, N, 3) as a multiple of its length in the template."""
    first, second = scene.imager.mesh.edges.T
    rest = np.linalg.norm(scene.imager.mesh.vertices[first] - scene.imager.mesh.vertices[second], axis=-1)
    lengths = np.linalg.norm(vertices[:, first] - vertices[:, second], axis=-1)
    return float((lengths / rest).max())


def crossing_edges(vertices: np.ndarray, scene: Scene) -> np.ndarray:
    """(T,) float64: edges of garment and body that pass through a face of the other."""
    faces = scene.imager.mesh.faces
    fractions = body_crossing_fractions(vertices, faces, scene.bodies, scene.body.faces)
    return fractions * len(scene.imager.mesh.edges)


def unseen(garments: tuple[str, ...], frames: slice, size: int) -> dict[str, float]:
    """Errors of the vertices that no view sees, in millimetres."""
    found: dict[str, float] = {}
    for garment in garments:
        bent = _bent(garment, frames, size)
        rest = scenes.at_rest(scenes.sample_clip(garment, scenes.BEND, slice(1)), size=size)
        for name, scene in ((garment, bent), (f"{garment}_rest", rest)):
            result: FusionResult = scene.fuse(solver_config("local_global"))
            hidden = ~scene.imager.visible.any(axis=0)
            for key, vertices in ((f"{name}_mm", result.initial), (f"{name}_fused_mm", result.vertices)):
                away = np.linalg.norm(vertices - scene.truth, axis=-1)[:, hidden]
                found[key] = 1000 * float(away.mean())
    return found


def _bent(garment: str, frames: slice, size: int) -> Scene:
    """A garment's bend clip, every twelfth frame, of these some."""
    clip = scenes.sample_clip(garment, scenes.BEND, slice(None, None, 12)).slice(frames)
    return scenes.true_scene(clip, size=size)


if __name__ == "__main__":
    command(__doc__, measure)
