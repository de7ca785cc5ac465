"""A small clip with known geometry: a tube of cloth around a bending tube, skinned to two joints."""

from __future__ import annotations

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Garment, Skeleton, Template

FPS = 30.0


def tube(
    radius: float, height: float, rings: int, sides: int, *, closed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """A tube about the y axis, 0 to `height`: vertices (N, 3) float32, faces (F, 3) int64 seen from outside.

    Vertices go ring by ring from the bottom; `closed` adds one vertex at the middle of each end.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.sin(angle), np.zeros(sides), np.cos(angle)], -1) * radius
    levels = np.linspace(0, height, rings)
    vertices = (circle[None] + levels[:, None, None] * [0, 1, 0]).reshape(-1, 3)
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    faces = [
        np.stack([a, b, b + sides], -1).reshape(-1, 3),
        np.stack([a, b + sides, a + sides], -1).reshape(-1, 3),
    ]
    if closed:
        s = np.arange(sides)
        n, top = len(vertices), (rings - 1) * sides
        vertices = np.concatenate([vertices, [[0, 0, 0], [0, height, 0]]])
        faces.append(np.stack([np.full(sides, n), (s + 1) % sides, s], -1))
        faces.append(np.stack([np.full(sides, n + 1), top + s, top + (s + 1) % sides], -1))
    return vertices.astype(np.float32), np.concatenate(faces).astype(np.int64)


def bending_weights(vertices: np.ndarray, height: float) -> np.ndarray:
    """(N, 2) float32: how much each vertex follows the lower and the upper joint, blended between."""
    upper = np.clip((vertices[:, 1] / height - 0.35) / 0.3, 0, 1)
    return np.stack([1 - upper, upper], -1).astype(np.float32)


def tube_clip(
    frames: int = 6,
    *,
    name: str = "tube/bend",
    girth: float = 1.0,
    tall: float = 1.0,
    rings: int = 12,
    sides: int = 14,
) -> Clip:
    """The clip: the body bends sideways and walks off, the garment follows with a ripple that skinning lacks.

    The body has 128 vertices and 2 joints, the garment 192 vertices; each of them stays outside the body. `girth` and
    `tall` scale both: the same garment on the same body in another shape. `rings` are the garment's, `sides` the
    body's: others make another garment or body.
    """
    height = tall
    body, body_faces = tube(0.15 * girth, height, 9, sides, closed=True)
    body_faces = body_faces.astype(np.int64)
    garment, garment_faces = tube(0.19 * girth, 0.6 * tall, rings, 16, closed=False)
    garment = garment + np.float32([0, 0.2 * tall, 0])
    time = np.arange(frames) / FPS
    poses = np.zeros((frames, 2, 3), np.float32)
    poses[:, 0, 1] = 1.5 * time  # turns about the vertical
    poses[:, 1, 2] = 0.5 * np.sin(4 * time)  # bends at the middle
    trans = np.stack([0.3 * time, np.zeros(frames), 0.8 * time], -1).astype(np.float32)
    joints_rest = np.array([[0, 0.1, 0], [0, 0.5, 0]], np.float32) * np.float32(tall)
    body_moves = _bend(body, bending_weights(body, height), poses, trans, joints_rest)
    outward = garment * np.float32([1, 0, 1]) / np.float32(0.19 * girth)
    ripple = 1 + np.sin(40 * garment[None, :, 1] + 9 * time[:, None])  # never inwards
    rippled = garment[None] + 0.004 * ripple[..., None] * outward
    garment_moves = _bend(rippled, bending_weights(garment, height), poses, trans, joints_rest)
    return Clip(
        template=Template(vertices=garment.astype(np.float32), faces=garment_faces),
        garment=Garment(garment_moves),
        body=Body(rest=body, faces=body_faces, vertices=body_moves),
        fps=FPS,
        skeleton=Skeleton(
            poses=poses,
            trans=trans,
            joints_rest=joints_rest,
            parents=np.array([-1, 0]),
            blend_weights=bending_weights(body, height),
        ),
        info={"source": "synthetic", "units": "m"},
        name=name,
    )


def _bend(
    rest: np.ndarray, weights: np.ndarray, poses: np.ndarray, trans: np.ndarray, joints: np.ndarray
) -> np.ndarray:
    """(N, 3) or (T, N, 3) rest points -> (T, N, 3) float32, the two joints written out by hand."""
    frames = []
    for t in range(len(poses)):
        points = (rest if rest.ndim == 2 else rest[t]).astype(np.float64)
        turn, bend = _about_y(poses[t, 0, 1]), _about_z(poses[t, 1, 2])
        upper = (points - joints[1]) @ bend.T + joints[1]
        blended = weights[:, :1] * points + weights[:, 1:] * upper
        frames.append((blended - joints[0]) @ turn.T + joints[0] + trans[t])
    return np.stack(frames).astype(np.float32)


def _about_y(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
