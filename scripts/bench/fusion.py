#!/usr/bin/env python
"""Maps to vertices: both solvers against each other and against the truth, on a T-shirt and a dress.

The garments (scripts/bench/cloth.py) are bent, twisted and folded by a centimetre about a body of 13,776 faces, with
edges as long as cloth keeps them. Their position maps of two views, 256 x 256, are blurred; their normal maps are
turned by a field that is smooth over as many pixels, 3 degrees (root mean square). What neither view sees stays unseen.
Everything runs in one process on at most two cores.

  speedup           seconds of adam (100 + 100 steps) / seconds of local_global, whole calls of `fuse` for 32 frames
                    with their bodies, set-up included; local_global shares frames out over both cores, adam, the
                    reference, does not
  cpu_speedup       the same of the seconds that cores were busy: what a single core would show
  rmse_*, normal_*  against the truth: mean distance of the vertices, mean angle of the vertex normals; _start is what
                    the maps gave; ratios are local_global / adam
  loss_*            weighted sum of the terms at the end of the stage, before the clean-up
  penetration_*     per cent of the vertices inside the body: from the maps, and after everything (local_global)
  sdf_ms            distance of as many points as the garment has vertices to one body, refit included
  *_seconds_STAGE   a frame; setup is once a template
  scaling           seconds a frame of 2 frames, set-up included, and the exponent of a power law through them; the
                    adam schedule's time is that of a tenth of its steps, times ten
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

# This folder's own fusion.py and render.py must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fusion import BodySdf, DecodedMaps, FusionConfig, FusionInputs, FusionResult, MovingSurface, fuse
from fusion.stages import edge_weights, normal_weights
from render import Mesh, TemplateImager, vertex_normals
from render.mesh.normals import safe_normalize
from scripts.bench import cloth
from scripts.bench.measuring import Results, command, interleaved

SOLVERS = ("local_global", "adam")
GARMENTS = {"tshirt": (cloth.TSHIRT, 4400), "dress": (cloth.DRESS, 12100)}
SIZE, BLUR = 256, 4.0  # pixels; standard deviation of the blur and of the normals' noise
NORMAL_DEGREES = 3.0
COUNTS, ADAM_MOST = (1000, 3000, 10000, 30000, 100000), 30000
FRAMES = 32  # of a call: eight poses, four times each
GPU_BATCHES = (1, 32, 256)
CORES = 2


@dataclass(frozen=True, eq=False)
class Scene:
    """A garment on its wearer with what a network might have predicted: T frames, metres."""

    imager: TemplateImager
    truth: np.ndarray  # (T, N, 3)
    positions: torch.Tensor  # (T, S, H, W, 3)
    normals: torch.Tensor
    body: Mesh
    bodies: np.ndarray  # (T, B, 3)
    contact_offset_m: float | None = None  # as a model that predicted the maps knows it

    def repeated(self, frames: int) -> Scene:
        """So many frames, the same ones again and again."""
        order = np.arange(frames) % len(self.truth)
        maps = {"positions": self.positions[order], "normals": self.normals[order]}
        return replace(self, truth=self.truth[order], bodies=self.bodies[order], **maps)

    def fuse(self, config: FusionConfig, frames: int | None = None, device: str = "cpu") -> FusionResult:
        """The first `frames` frames, positions, normals and body."""
        inputs = FusionInputs(
            maps=DecodedMaps(self.positions[:frames], self.normals[:frames]),
            body=MovingSurface(self.bodies[:frames], self.body.faces),
            contact_offset_m=self.contact_offset_m,
        )
        return fuse(self.imager, inputs, config, device=device)


def measure(quick: bool) -> Results:
    """All numbers: a section a garment, one for the scaling, and one for each GPU measurement where there is a GPU."""
    with _cores(CORES):
        if quick:
            return {
                **{
                    name: garment(scene(cut, 300, frames=1, size=48), rounds=1, steps=2)
                    for name, (cut, _) in GARMENTS.items()
                },
                "scaling": scaling((200, 400), size=32, steps=2),
            }
        results: Results = {}
        for name, (cut, n_vertices) in GARMENTS.items():
            made = scene(cut, n_vertices, frames=8)
            results[name] = garment(made.repeated(FRAMES), rounds=1)
            if torch.cuda.is_available():
                results[f"{name}_gpu"] = on_gpu(made)
        results["scaling"] = scaling(COUNTS)
        return results


def scene(cut: cloth.Cut, n_vertices: int, *, frames: int, size: int = SIZE, rounds: int = 200) -> Scene:
    """Truth and disturbed maps; `rounds` of the truth's own solution, which cost most for large garments."""
    mesh, body = cloth.garment(cut, n_vertices), cloth.wearer()
    imager = TemplateImager.build(mesh, size=(size, size))
    truth = cloth.worn(mesh, body, frames, rounds=rounds)
    points = torch.from_numpy(truth)
    positions, normals = imager.operator(points), imager.operator(vertex_normals(points, imager.faces))
    sigma = BLUR * size / SIZE
    bodies = cloth.moved(body.vertices, frames).astype(np.float32)
    return Scene(imager, truth, blurred(positions, imager.mask, sigma), turned(normals, sigma), body, bodies)


def blurred(images: torch.Tensor, mask: torch.Tensor, sigma: float) -> torch.Tensor:
    """Images (T, S, H, W, C) under a Gaussian of `sigma` pixels that does not mix in the background."""
    share = gaussian_filter(mask.numpy().astype(np.float32), (0, sigma, sigma))[..., None]
    mixed = gaussian_filter(images.numpy(), (0, 0, sigma, sigma, 0)) / np.maximum(share, 1e-6)
    return torch.from_numpy(np.where(mask.numpy()[..., None], mixed, 0).astype(np.float32))


def turned(normals: torch.Tensor, sigma: float, degrees: float = NORMAL_DEGREES) -> torch.Tensor:
    """Normals (T, S, H, W, 3) turned by noise that is smooth over `sigma` pixels, `degrees` root mean square."""
    noise = gaussian_filter(
        np.random.default_rng(0).standard_normal(normals.shape), (0, 0, sigma, sigma, 0)
    ).astype(np.float32)
    noise /= noise.std() * np.sqrt(2)  # two of the three directions turn a normal
    unit = safe_normalize(normals)
    found = safe_normalize(unit + np.tan(np.radians(degrees)) * torch.from_numpy(noise))
    return torch.where((unit != 0).any(-1, keepdim=True), found, 0.0)


def garment(made: Scene, *, rounds: int, steps: int = 100) -> dict[str, float]:
    """One garment's section."""
    configs = {name: solver_config(name, steps=steps) for name in SOLVERS}
    results: dict[str, FusionResult] = {}
    stages: dict[str, list[dict[str, float]]] = {name: [] for name in SOLVERS}

    cpu: dict[str, list[float]] = {name: [] for name in SOLVERS}

    def fused(name: str) -> None:
        started = time.process_time()
        results[name] = made.fuse(configs[name])
        cpu[name].append(time.process_time() - started)
        stages[name].append(results[name].report["stage_seconds"])

    times = interleaved({name: lambda name=name: fused(name) for name in SOLVERS}, rounds=rounds)  # type: ignore[misc]
    frames, mesh = len(made.truth), made.imager.mesh
    start = results["adam"].initial
    found = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "body_faces": len(made.body.faces),
        "unseen_percent": results["adam"].report["unseen_percent"],
        "truth_edge_strain_percent": cloth.edge_strain_percent(mesh, made.truth),
        "speedup": times.ratio("adam", "local_global"),
        "cpu_speedup": median(cpu["adam"]) / median(cpu["local_global"]),
        "rmse_mm_start": rmse_mm(start, made),
        "normal_degrees_start": normal_degrees(start, made),
        "penetration_percent_truth": penetration_percent(made.truth, made),
        "penetration_percent_before": penetration_percent(start, made),
        "penetration_percent_after": penetration_percent(results["local_global"].vertices, made),
        "sdf_ms": sdf_ms(made, rounds),
    }
    for name, result in results.items():
        found[f"{name}_seconds"] = times.s(name) / frames
        found[f"{name}_rmse_mm"] = rmse_mm(result.vertices, made)
        found[f"{name}_normal_degrees"] = normal_degrees(result.vertices, made)
        found[f"{name}_penetration_percent"] = penetration_percent(result.vertices, made)
        found |= {f"{name}_loss_{key}": value for key, value in losses(result, configs[name]).items()}
        for stage in stages[name][0]:
            seconds = median(spent[stage] for spent in stages[name])
            found[f"{name}_seconds_{stage}"] = seconds / (1 if stage == "setup" else frames)
    for key, measured in (("rmse_ratio", "rmse_mm"), ("normal_error_ratio", "normal_degrees")):
        found[key] = found[f"local_global_{measured}"] / found[f"adam_{measured}"]
    return found


def solver_config(solver: str, *, steps: int = 100, batch: int | None = None) -> FusionConfig:
    """The defaults with this solver; `steps` for both stages of adam, `batch` in place of the default's frames."""
    changed = {"edge_steps": steps, "normal_steps": steps} | (
        {} if batch is None else {"batch_frames": batch}
    )
    return FusionConfig.model_validate({"solver": solver} | changed)


def rmse_mm(vertices: np.ndarray, made: Scene) -> float:
    """Mean over frames and vertices of the distance to the truth."""
    return 1000 * float(np.linalg.norm(vertices - made.truth, axis=-1).mean())


def normal_degrees(vertices: np.ndarray, made: Scene) -> float:
    """Mean over frames and vertices of the angle between vertex normal and true vertex normal."""
    found, true = (
        vertex_normals(torch.from_numpy(points).double(), made.imager.faces)
        for points in (vertices, made.truth)
    )
    return float(torch.rad2deg(torch.acos((found * true).sum(-1).clamp(-1, 1))).mean())


def penetration_percent(vertices: np.ndarray, made: Scene) -> float:
    """Share of the vertices inside the body."""
    sdf = BodySdf(made.body.faces, made.bodies.shape[1])
    sdf.update(made.bodies)
    return 100 * float((sdf.query(torch.from_numpy(vertices)).distance < 0).double().mean())


def losses(result: FusionResult, config: FusionConfig) -> dict[str, float]:
    """What each stage minimises, at its end: the weighted sum of the terms in its report (lengths in cm)."""
    weights = {"edge": edge_weights(config), "normal": normal_weights(config)}
    return {
        stage: sum(weights[stage][term] * value for term, value in ends["end"].items())
        for stage, ends in result.report["terms"].items()
    }


def sdf_ms(made: Scene, rounds: int) -> float:
    """Milliseconds to move the body and ask for the distance of one frame's vertices, as `fuse` asks."""
    sdf = BodySdf(made.body.faces, made.bodies.shape[1], band_m=FusionConfig().sdf_band_m)
    points = torch.from_numpy(made.truth[-1:])

    def moved_and_asked() -> None:
        sdf.update(made.bodies[-1:])
        sdf.query(points)

    return interleaved({"sdf": moved_and_asked}, rounds=3 * rounds).ms("sdf")


def scaling(counts: tuple[int, ...], *, size: int = SIZE, steps: int = 10) -> dict[str, float]:
    """Seconds a frame against the number of vertices, and the exponent of a straight line in the logarithms."""
    found: dict[str, float] = {}
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in SOLVERS}
    for count in counts:
        made = scene(cloth.TSHIRT, count, frames=2, size=size, rounds=20)
        n = len(made.imager.mesh.vertices)
        some, none, whole = (
            solver_config("adam", steps=steps),
            solver_config("adam", steps=0),
            solver_config("local_global"),
        )
        calls = {"local_global": lambda made=made, whole=whole: made.fuse(whole)}  # type: ignore[misc]
        if count <= ADAM_MOST:
            calls["some"] = lambda made=made, some=some: made.fuse(some)  # type: ignore[misc]
            calls["none"] = lambda made=made, none=none: made.fuse(none)  # type: ignore[misc]
        times = interleaved(calls, rounds=1)
        spent["local_global"].append((n, times.s("local_global") / 2))
        if count <= ADAM_MOST:
            per_step = max(times.s("some") - times.s("none"), 0.0) / steps
            spent["adam"].append((n, (times.s("none") + 100 * per_step) / 2))
    for name, measured in spent.items():
        found |= {f"{name}_seconds_{n}": seconds for n, seconds in measured}
        exponent = np.polyfit(*np.log(np.array(measured)).T, 1)[0]
        found[f"{name}_exponent"] = float(exponent)
    return found


def on_gpu(made: Scene) -> dict[str, float]:
    """Frames a second on the GPU, by solver and batch; every call with set-up, transfers and body."""
    found: dict[str, float] = {}
    for batch in GPU_BATCHES:
        many = made.repeated(batch)
        configs = {name: solver_config(name, batch=batch) for name in SOLVERS}
        calls = {
            name: lambda many=many, c=config: many.fuse(c, device="cuda") for name, config in configs.items()
        }  # type: ignore[misc]
        times = interleaved(calls, rounds=2)
        found |= {f"{name}_frames_per_second_{batch}": batch / times.s(name) for name in SOLVERS}
    return found


@contextmanager
def _cores(most: int) -> Iterator[None]:
    """At most so many cores for this process inside the block, where the system can limit them."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before, threads = os.sched_getaffinity(0), torch.get_num_threads()
    os.sched_setaffinity(0, sorted(before)[:most])
    torch.set_num_threads(min(most, len(before)))
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
        torch.set_num_threads(threads)


if __name__ == "__main__":
    command(__doc__, measure)
