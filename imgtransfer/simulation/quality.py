"""Gates for simulated clips: what explodes, stretches beyond reason, or leaves or sinks into the body is refused."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.simulation.config import GateConfig
from render.mesh import Mesh

CLEARANCE = 0.001  # metres; where vertices that ended inside the body are put, in front of its surface
_PUSHES = 6  # a push out of one limb may end in another


@dataclass(frozen=True)
class Quality:
    """Measured on a clip; lengths in metres, speeds in m/s. Values are infinite where vertices are not finite."""

    median_stretch: float
    p99_stretch: float
    sunk_percent: float
    deepest: float
    penetration_percent: float
    speed: float
    reach: float

    def as_text(self) -> str:
        """One line for logs."""
        return ", ".join(f"{name} {value:.3g}" for name, value in asdict(self).items())


def push_out(vertices: np.ndarray, sdf: BodySdf) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Put vertices that lie inside the body, or closer than 1 mm, 1 mm in front of its closest surface point.

    Args:
        vertices: (N, 3) float32. sdf: the body, where it stands in this frame.

    Returns:
        The vertices, and their signed distances before and after, (N,) each.
    """
    pushed = torch.from_numpy(vertices.copy())
    found = sdf.query(pushed)
    before = found.distance.numpy().copy()
    for _ in range(_PUSHES):
        inside = found.distance < CLEARANCE * 0.9
        if not inside.any():
            break
        pushed[inside] = found.closest[inside] + CLEARANCE * found.direction[inside]
        found = sdf.query(pushed)
    return pushed.numpy(), before, found.distance.numpy()


def measure(
    template: Mesh,
    vertices: np.ndarray,
    body: np.ndarray,
    *,
    before: np.ndarray,
    after: np.ndarray,
    fps: float,
) -> Quality:
    """Measure a clip.

    Args:
        template: the rest shape. vertices: (T, N, 3) metres. body: (T, B, 3).
        before, after: (T, N) signed distances to the body before and after `push_out`.
    """
    if not np.isfinite(vertices).all():
        return Quality(*[np.inf] * 7)
    start, end = template.edges.T
    rest = np.linalg.norm(template.vertices[end] - template.vertices[start], axis=-1)
    stretch = np.linalg.norm(vertices[:, end] - vertices[:, start], axis=-1) / rest

    def speed(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=1, initial=0.0) * fps

    return Quality(
        median_stretch=float(np.abs(np.median(stretch, axis=1) - 1).max()),
        p99_stretch=float(np.percentile(stretch, 99)),
        sunk_percent=float(100 * (before < 0).mean()),
        deepest=float(max(0.0, -before.min())),
        penetration_percent=float(100 * (after < 0).mean()),
        speed=float(max(0.0, (speed(vertices) - speed(body)).max(initial=0.0))),
        reach=float(after.max()),
    )


def faults(quality: Quality, gates: GateConfig) -> list[str]:
    """What is wrong with a clip, one text a gate; empty where it may be used."""
    found = []
    for name, limit in gates.model_dump().items():
        value = getattr(quality, name)
        if not value <= limit:
            found.append(f"{name} is {value:.3g}, at most {limit:g} allowed")
    return found
