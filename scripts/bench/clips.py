"""Synthetic clips that the benches of training and of data sets share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imgtransfer.data import grid
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template
from scripts.bench import shapes


def synthetic_clip(garment: tuple[int, int], body: tuple[int, int], frames: int) -> Clip:
    """A synthetic clip; its root stands still."""
    cloth, inside = shapes.garment(*garment), shapes.body(*body)
    return Clip(
        template=Template(vertices=cloth.vertices.astype(np.float32), faces=cloth.faces),
        garment=Garment(shapes.wrinkled(cloth, frames)),
        body=Body(
            rest=inside.vertices.astype(np.float32),
            faces=inside.faces,
            vertices=shapes.moved(inside.vertices, frames),
        ),
        fps=30.0,
        skeleton=Skeleton(
            poses=np.zeros((frames, 1, 3), np.float32),
            trans=np.zeros((frames, 3), np.float32),
            joints_rest=np.zeros((1, 3), np.float32),
            parents=np.array([-1]),
        ),
        name="tube",
    )


def clip_on_grid(garment: tuple[int, int], body: tuple[int, int], frames: int) -> Clip:
    """The same with its vertices on the grid that simulation rounds to."""
    clip = synthetic_clip(garment, body, frames)
    assert clip.garment is not None
    return replace(
        clip,
        garment=Garment(grid.round_to_grid(clip.garment.vertices)),
        body=replace(clip.body, vertices=grid.round_to_grid(clip.body.vertices)),
    )
