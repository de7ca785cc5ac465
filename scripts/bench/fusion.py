#!/usr/bin/env python
"""Maps to vertices: where the time goes, and each choice made for speed against its alternative.

A tube of cloth bends, twists and wrinkles (1 cm) about a body of 13,776 faces; its true maps of 128 x 128 are fused
with the paper's schedule, body collision and clean-up included. One torch thread, but for `two_threads`.

  seconds_*         a frame, by stage; seconds_setup is once (matrices and search structures)
  ratio_a_to_b      how many times as long a takes as b
  sdf_*             one body and one frame of points; "winding" and "normal" are two ways to tell inside from outside
  difference_mm_*   mean distance between the vertices of the two results
  penetration_*     per cent of vertices inside the body: from the position maps, after both stages, after the clean-up
"""

from __future__ import annotations

import importlib
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

# This folder's own fusion.py and render.py must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fusion import BodySdf, FusionConfig, FusionResult, Topology, fuse
from fusion.topology import vertices_first
from render import Mesh, TemplateImager, vertex_normals
from scripts.bench import shapes
from scripts.bench.measuring import Results, command, interleaved

_MODULE = importlib.import_module("fusion.fuse")  # `fusion.fuse` is the function of that name
STAGES = {
    "setup": (_MODULE._Solver, "__init__"),
    "start": (_MODULE._Solver, "_start"),
    "edge": (_MODULE, "edge_stage"),
    "normal": (_MODULE, "normal_stage"),
    "clearance": (_MODULE, "clear_body"),
}


def measure(quick: bool) -> Results:
    """All numbers, one section a template."""
    if quick:
        config = FusionConfig(edge_steps=2, normal_steps=2)
        mesh, body = shapes.garment(20, 12), shapes.body(20, 12)
        return {"tube_0.2k": _template(mesh, body, (32, 32), config, frames=1, rounds=1)}
    body = shapes.body(*shapes.SMPL_SIZED)
    return {
        name: _template(shapes.garment(*shape), body, (128, 128), FusionConfig(), frames=4, rounds=3)
        for name, shape in {"tube_4k": shapes.SMALL, "tube_12k": shapes.LARGE}.items()
    }


def _template(
    mesh: Mesh, body: Mesh, size: tuple[int, int], config: FusionConfig, *, frames: int, rounds: int
) -> dict[str, float]:
    imager = TemplateImager.build(mesh, size=size)
    truth = torch.from_numpy(shapes.wrinkled(mesh, frames))
    bodies = shapes.moved(body.vertices, frames)
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "body_faces": len(body.faces),
        **_whole(imager, truth, body.faces, bodies, config, rounds=rounds),
        **_normals(mesh, truth, rounds),
        **_sdf(truth[-1], body, bodies, rounds),
    }


def _whole(
    imager: TemplateImager,
    truth: torch.Tensor,
    body_faces: np.ndarray,
    bodies: np.ndarray,
    config: FusionConfig,
    *,
    rounds: int,
) -> dict[str, float]:
    """`fuse` from end to end: by stage, with two threads, with a distance query at every step."""
    normals = imager.operator(vertex_normals(truth, imager.faces))
    positions = imager.operator(truth)
    results: dict[str, FusionResult] = {}
    spent: dict[str, list[float]] = defaultdict(list)

    def fused(name: str, *, threads: int = 1, sdf_every_steps: int = config.sdf_every_steps) -> None:
        with ExitStack() as stack:
            stack.enter_context(patch.object(_MODULE, "_one_thread", lambda: _threads(threads)))
            if name == "ours":
                for stage, (owner, attribute) in STAGES.items():
                    clock = _clocked(getattr(owner, attribute), spent[stage])
                    stack.enter_context(patch.object(owner, attribute, clock))
            results[name] = fuse(
                imager,
                positions=positions,
                normals=normals,
                body_vertices=bodies,
                body_faces=body_faces,
                config=config.model_copy(update={"sdf_every_steps": sdf_every_steps}),
            )

    times = interleaved(
        {
            "ours": lambda: fused("ours"),
            "two_threads": lambda: fused("two_threads", threads=2),
            "every_step": lambda: fused("every_step", sdf_every_steps=1),
        },
        rounds=rounds,
    )
    frames = len(truth)
    # The first call of each stage is the warm-up.
    found = {
        f"seconds_{stage}": median(spent[stage][1:]) / (1 if stage == "setup" else frames) for stage in STAGES
    }
    sdf = BodySdf(body_faces, bodies.shape[1])
    sdf.update(bodies)
    initial = torch.from_numpy(results["ours"].initial)
    inside = results["ours"].report["penetration_percent"]
    apart = results["every_step"].vertices - results["ours"].vertices
    return found | {
        "seconds_per_frame": times.s("ours") / frames,
        "ratio_two_threads_to_one": times.ratio("two_threads", "ours"),
        "ratio_sdf_every_step_to_every_fifth": times.ratio("every_step", "ours"),
        "penetration_percent_start": 100 * float((sdf.query(initial).distance < 0).float().mean()),
        "penetration_percent_optimised": inside["before_clearance"],
        "penetration_percent_cleared": inside["after"],
        "difference_mm_sdf_every_step": 1000 * float(np.linalg.norm(apart, axis=-1).mean()),
    }


def _normals(mesh: Mesh, truth: torch.Tensor, rounds: int) -> dict[str, float]:
    """Vertex normals and their gradient: as sparse products, and by gathering and `index_add`."""
    topology, faces = Topology(mesh), torch.from_numpy(mesh.faces)
    upstream = torch.rand_like(truth)
    ours = vertices_first(truth.clone()).requires_grad_()
    theirs = truth.clone().requires_grad_()

    def gradient(vertices: torch.Tensor, normals: Callable[[torch.Tensor], torch.Tensor]) -> None:
        torch.autograd.grad(normals(vertices), vertices, upstream)

    times = interleaved(
        {
            "topology": lambda: gradient(ours, topology.normals),
            "topology_frames_first": lambda: gradient(theirs, topology.normals),
            "vertex_normals": lambda: gradient(theirs, lambda vertices: vertex_normals(vertices, faces)),
        },
        rounds=3 * rounds,
    )
    return {
        "topology_normals_ms": times.ms("topology") / len(truth),
        "ratio_vertex_normals_to_topology": times.ratio("vertex_normals", "topology"),
        "ratio_frames_first_to_vertices_first": times.ratio("topology_frames_first", "topology"),
    }


def _sdf(points: torch.Tensor, body: Mesh, bodies: np.ndarray, rounds: int) -> dict[str, float]:
    """Distance queries and what moving the body costs, both signs; refitting against building anew."""
    pose = bodies[-1]
    winding, normal = _made("winding", body, pose), _made("normal", body, pose)
    times = interleaved(
        {
            "query_winding": lambda: winding.query(points),
            "query_normal": lambda: normal.query(points),
            "refit_winding": lambda: winding.update(pose),
            "refit_normal": lambda: normal.update(pose),
            "build_winding": lambda: _made("winding", body, pose),
            "build_normal": lambda: _made("normal", body, pose),
        },
        rounds=3 * rounds,
    )
    found: dict[str, float] = {}
    for sign in ("winding", "normal"):
        found[f"sdf_ms_{sign}"] = times.ms(f"query_{sign}") + times.ms(f"refit_{sign}")
        found[f"sdf_query_ms_{sign}"] = times.ms(f"query_{sign}")
        found[f"sdf_refit_ms_{sign}"] = times.ms(f"refit_{sign}")
        found[f"ratio_build_to_refit_{sign}"] = times.ratio(f"build_{sign}", f"refit_{sign}")
    found["ratio_sdf_winding_to_normal"] = times.ratio("query_winding", "query_normal")
    return found


def _made(sign: Any, body: Mesh, pose: np.ndarray) -> BodySdf:
    sdf = BodySdf(body.faces, len(body.vertices), sign=sign)
    sdf.update(pose)
    return sdf


def _clocked(call: Callable[..., Any], spent: list[float]) -> Callable[..., Any]:
    """The same function, adding the seconds of each call to `spent`."""

    def clocked(*arguments: Any, **named: Any) -> Any:
        started = time.perf_counter()
        result = call(*arguments, **named)
        spent.append(time.perf_counter() - started)
        return result

    return clocked


@contextmanager
def _threads(number: int) -> Iterator[None]:
    """Torch with so many threads inside the block."""
    before = torch.get_num_threads()
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(before)


if __name__ == "__main__":
    command(__doc__, measure)
