"""A body of cylinders, measured by hand: a trunk, and arms and legs if they are wanted."""

from __future__ import annotations

import numpy as np
import trimesh

from imgtransfer.bodies.smpl import INDEX, JOINTS
from imgtransfer.garments.figure import Figure
from tests.helpers import synthetic

# The left side, metres; the right one mirrors x. Arms are level, legs straight down.
_MIDDLE = {"pelvis": 0.0, "spine1": 0.1, "spine2": 0.2, "spine3": 0.35, "neck": 0.55, "head": 0.65}
_SIDE = {
    "hip": (0.1, -0.1), "knee": (0.1, -0.5), "ankle": (0.1, -0.9), "foot": (0.1, -0.95),
    "collar": (0.06, 0.45), "shoulder": (0.2, 0.5), "elbow": (0.5, 0.5), "wrist": (0.75, 0.5),
}  # fmt: skip


def standing_joints() -> np.ndarray:
    """(22, 3) the SMPL joints of somebody in a T-pose, the pelvis at the origin."""
    joints = np.zeros((len(JOINTS), 3))
    for name, height in _MIDDLE.items():
        joints[INDEX[name], 1] = height
    for name, (across, height) in _SIDE.items():
        for side, sign in (("left", 1), ("right", -1)):
            joints[INDEX[f"{side}_{name}"], :2] = sign * across, height
    return joints


def rod(start: tuple[float, ...], end: tuple[float, ...], radius: float) -> trimesh.Trimesh:
    """A closed cylinder of 48 sides and rings of at most 4 cm from one point to another."""
    length = float(np.linalg.norm(np.subtract(end, start)))
    points, faces = synthetic.tube(radius, length, int(np.ceil(length / 0.04)) + 1, 48, closed=True)
    along = trimesh.geometry.align_vectors([0, 1, 0], np.subtract(end, start))[:3, :3]
    return trimesh.Trimesh(points @ along.T + np.array(start), faces, process=False)


def figure_of(*parts: trimesh.Trimesh) -> Figure:
    """The figure whose skin is made of these parts, with `standing_joints`."""
    skin = trimesh.util.concatenate(list(parts))
    return Figure(np.asarray(skin.vertices, np.float64), np.asarray(skin.faces), standing_joints())


def trunk(radius: float = 0.15) -> trimesh.Trimesh:
    """An upright cylinder about the pelvis, from the ankles to over the head."""
    return rod((0, -0.9, 0), (0, 0.7, 0), radius)
