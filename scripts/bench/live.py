#!/usr/bin/env python
"""The garment that `imgtransfer view` predicts live: what a pose, a shape of the body and another garment take.

The general checkpoint, a section for a T-shirt and one for a dress, one thread.

  predict_ms, fuse_ms          of a pose, as the page says
  slider_to_page_ms            from a slider that is moved to all of the frame given to the server of the page
  ratio_fused_to_read          of a pose with its fusion, to one whose vertices are read from the maps alone
  shape_ms                     garment and body in another shape, before a pose of it is predicted
  ratio_shape_to_made          to a garment that is made for the shape, as `imgtransfer dress` does
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import numpy as np

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.bodies import AnnyConfig, AnnyShape, SkinnedBody
from imgtransfer.dressing.hanging import hanging_garment
from imgtransfer.shipped import shipped_model
from imgtransfer.viewing import LiveControls, Show, live, page_server
from imgtransfer.viewing.live import GARMENTS, LiveModel, Worn
from render import Mesh
from scripts.bench.measuring import Results, command, interleaved

KINDS = ("tshirt", "dress")


def measure(quick: bool) -> Results:
    """All numbers."""
    path = shipped_model("general")
    assert path is not None
    model, rounds = LiveModel(path), 1 if quick else 9
    return {kind: _garment(model, path, kind, rounds) for kind in KINDS[: 1 if quick else None]}


def _garment(model: LiveModel, path: Path, kind: str, rounds: int) -> dict[str, float]:
    worn, weights = model.worn(kind, AnnyShape()), _weights()
    poses = itertools.cycle(float(angle) for angle in range(-60, 61, 20))
    shown: list[tuple[float, float]] = []
    times = interleaved(
        {
            "fused": lambda: shown.append(_posed(worn, next(poses), fused=True)),
            "read": lambda: _posed(worn, next(poses), fused=False),
            "shape": lambda: model.worn(kind, AnnyShape(weight=next(weights))),
            "made": lambda: _made(model, kind, next(weights)),
        },
        rounds=rounds,
    )
    predicted, fused = np.median(shown, axis=0).tolist()
    return {
        "predict_ms": predicted,
        "fuse_ms": fused,
        "slider_to_page_ms": _drawing(path, kind, rounds),
        "ratio_fused_to_read": times.ratio("fused", "read"),
        "shape_ms": times.ms("shape"),
        "ratio_shape_to_made": times.ratio("shape", "made"),
    }


def _posed(worn: Worn, degrees: float, *, fused: bool) -> tuple[float, float]:
    return worn.posed({"arms up": degrees, "left leg forward": degrees / 2}, fused=fused).milliseconds


def _weights() -> Iterator[float]:
    """Shapes that differ, so that nothing of one is kept for the next."""
    return (0.3 + 0.001 * (number % 400) for number in itertools.count())


def _made(model: LiveModel, kind: str, weight: float) -> None:
    """Prepare a garment that is refitted to the shape, in place of one that is carried along with the skin."""
    shape = AnnyShape(weight=weight)

    def made(body: SkinnedBody, kind: str) -> Mesh:
        return hanging_garment(GARMENTS[kind](detail="small"), AnnyConfig(shape=shape.model_dump()))

    with patch.object(live, "_on", made):
        model.worn(kind, shape)


def _drawing(path: Path, kind: str, rounds: int) -> float:
    """Milliseconds from a slider that was moved to all of the frame given to the page."""
    controls = LiveControls(path, on=True)
    with page_server("127.0.0.1", 0) as server:
        show = Show(server, {}, controls)
        controls._kind.value = kind
        show.draw()
        angles = itertools.cycle(range(-60, 61, 20))

        def step() -> None:
            controls._turns["arms up"].value = next(angles)
            show.step()

        return interleaved({"step": step}, rounds=rounds).ms("step")


if __name__ == "__main__":
    command(__doc__, measure)
