#!/usr/bin/env python
"""Cloth simulation: frames a second on one core, where the time goes, and what the project's own descent saves.

A T-shirt of about 1,830 vertices (`detail: small`) on the Anny body, in motions of the library. One thread.

  frames_per_s             frames a second of a clip, warm-up frames counted, gates measured
  p99_stretch              99th percentile of edge length over rest length; sunk_percent of vertices before push-out
  gates_failed             of the default gates
  *_ms                     of a frame of `substeps`: the body's skin; its transfer to Warp and refit; the parts of a
                           step (start, contacts, descent)
  ratio_newton_to_ours     time of Newton's SolverVBD over ours, same model, substeps and iterations
  ratio_self_contact_to_without      ours with contact of the cloth with itself over ours without
  ratio_newton_to_ours_self_contact  SolverVBD over ours, both with it
  difference_mm            median distance of a vertex between the two after these frames; contact multiplies rounding
"""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

# This folder's own files must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.bodies.config import make_body
from imgtransfer.bodies.skinned import BonePoses
from imgtransfer.garments.config import TShirtConfig
from imgtransfer.garments.garment import make_garment
from imgtransfer.motions.library import make_motion
from imgtransfer.simulation.cloth.model import ClothOnBody
from imgtransfer.simulation.cloth.newton_descent import NewtonDescent
from imgtransfer.simulation.config import ClothConfig, SimulateConfig, SolverConfig
from imgtransfer.simulation.quality import faults
from imgtransfer.simulation.run import simulate_clip
from scripts.bench.measuring import Results, command

MOTIONS = ("walk", "squat", "punch")
_STAGES = {"find_contacts": "contacts", "descend": "descent"}  # what else a step does is its start


def measure(quick: bool) -> Results:
    """All numbers, by the motion."""
    garment = TShirtConfig(edge_length=0.045) if quick else TShirtConfig(detail="small")
    return {name: _motion(name, garment, quick) for name in (MOTIONS[:1] if quick else MOTIONS)}


def _motion(name: str, garment: TShirtConfig, quick: bool) -> dict[str, float]:
    solver = SolverConfig(settle_seconds=0.2, warm_up_seconds=0.1) if quick else SolverConfig()
    config = SimulateConfig(garment=garment, solver=solver)
    motion = make_motion(name, seed=1, seconds=0.3 if quick else 2.5)
    simulate_clip(
        make_motion(name, seed=1, seconds=0.2), config
    )  # compiles, makes the garment, lets it settle
    started = time.perf_counter()
    clip, quality = simulate_clip(motion, config)
    seconds = time.perf_counter() - started
    frames = len(motion.poses) + round(solver.warm_up_seconds * motion.fps)
    return {
        "vertices": len(clip.template.vertices),
        "frames_per_s": frames / seconds,
        "p99_stretch": quality.p99_stretch,
        "sunk_percent": quality.sunk_percent,
        "gates_failed": len(faults(quality, config.gates)),
        **_stages(garment, name, solver, frames=2 if quick else 10),
    }


def _stages(garment: TShirtConfig, name: str, solver: SolverConfig, *, frames: int) -> dict[str, float]:
    """Milliseconds of a frame by stage, and the same frames by Newton's solver."""
    body = make_body()
    mesh = make_garment(body, garment).mesh
    material = ClothConfig()
    motion = make_motion(name, seed=1, seconds=1.2)
    count = solver.min_substeps
    bones = body.bone_poses(motion.poses, motion.trans, leg_length=motion.leg_length)
    plain = solver.model_copy(update={"relaxation": 1.0})  # as Newton's
    folding = plain.model_copy(update={"self_contact": True})
    ours, theirs, ours_itself, theirs_itself = (
        ClothOnBody(mesh, body.rest, body.faces, material, how) for how in (plain, plain, folding, plain)
    )
    theirs.stepper = NewtonDescent(theirs.model, material, solver.iterations, self_contact=False)
    theirs_itself.stepper = NewtonDescent(theirs_itself.model, material, solver.iterations)
    seconds: defaultdict[str, float] = defaultdict(float)

    def timed(stage: str, call: Any, *arguments: Any) -> Any:
        started = time.perf_counter()
        result = call(*arguments)
        seconds[stage] += time.perf_counter() - started
        return result

    duration = 1 / (motion.fps * count)
    descent: Any = ours.stepper
    launches = descent.commands(ours.state, duration)
    shift = bones.root[0] - body.bone_heads[0]
    first = body.vertices(body.transforms(bones)[:1].astype(np.float32))[0] - shift.astype(np.float32)
    for cloth in (ours, theirs, ours_itself, theirs_itself):
        cloth.step(first, duration)  # compiles
    share = np.arange(1, count + 1)[:, None] / count

    def skins_of(frame: int) -> np.ndarray:
        start, end = (
            BonePoses(
                np.repeat(bones.rotations[k : k + 1], count, 0), np.repeat(bones.root[k : k + 1], count, 0)
            )
            for k in (frame - 1, frame)
        )
        transforms = body.transforms(body.interpolate(start, end, share))
        return body.vertices(transforms.astype(np.float32))

    for frame in range(1, frames + 1):
        skins = timed("skin", skins_of, frame)
        for skin in skins - shift.astype(np.float32):
            timed("collider", ours.move_body, skin, duration)
            for kernel, launch in launches:
                timed(_STAGES.get(kernel, "start"), launch.launch)
            timed("newton", theirs.step, skin, duration)
            timed("itself", ours_itself.step, skin, duration)
            timed("newton_itself", theirs_itself.step, skin, duration)
    steps = ("collider", "start", "contacts", "descent")
    own = sum(seconds[stage] for stage in steps)
    return {
        "substeps": count,
        **{f"{stage}_ms": 1000 * seconds[stage] / frames for stage in ("skin", *steps)},
        "ratio_newton_to_ours": seconds["newton"] / own,
        "ratio_self_contact_to_without": seconds["itself"] / own,
        "ratio_newton_to_ours_self_contact": seconds["newton_itself"] / seconds["itself"],
        "difference_mm": float(1000 * np.median(np.linalg.norm(ours.vertices - theirs.vertices, axis=1))),
    }


if __name__ == "__main__":
    command(__doc__, measure)
