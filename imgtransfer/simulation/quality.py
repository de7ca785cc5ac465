"""Gates for simulated clips: what explodes, stretches beyond reason, or leaves or sinks into the body is refused."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

import numpy as np
import torch
from scipy.ndimage import median_filter

from fusion import BodySdf
from fusion.obstacles import body_crossing_fractions, self_crossing_fractions
from imgtransfer.simulation.config import GateConfig
from imgtransfer.simulation.slip import slip
from render.mesh.measures import area_fractions, edge_lengths
from render.mesh.mesh import Mesh

CLEARANCE = 0.001  # metres; where vertices that ended inside the body are put, in front of its surface
_SLOW_CLOTH = 0.5  # m/s; changes of energy below it are no spike
_STILL_BODY = 0.05  # m/s; a body whose fastest point is slower rests
_PUSHES = 6  # a push out of one limb may end in another


@dataclass(frozen=True)
class Quality:
    """Measured on a clip; lengths in metres, speeds in m/s. Values are infinite where vertices are not finite.

    Args:
        median_stretch: |median over edges of length / rest length - 1|, of the worst frame.
        p99_stretch: 99th percentile of length / rest length over edges and frames.
        worst_p99_stretch: the same over edges, of the frame where it is largest.
        sunk_percent: of the vertices, inside the body before `push_out`; mean over frames.
        deepest: metres that a vertex lay inside the body before `push_out`.
        penetration_percent: of the vertices, inside the body after `push_out`; mean over frames.
        speed: m/s by which a vertex is faster than the body's fastest, in the worst frame.
        reach: metres to the body, of the farthest vertex.
        energy_spike: see `energy_spike`. jitter: see `jitter`.
        slip: see `imgtransfer.simulation.slip`.
        crossing_percent: edges of cloth and body that pass through faces of the other, after `push_out`, of the cloth's
            edges; mean over frames.
        self_crossing_percent: of the edges, passing through the cloth itself; mean over frames. No gate looks at it.
    """

    median_stretch: float
    p99_stretch: float
    worst_p99_stretch: float
    sunk_percent: float
    deepest: float
    penetration_percent: float
    speed: float
    reach: float
    energy_spike: float
    jitter: float
    slip: float
    crossing_percent: float
    self_crossing_percent: float

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
    nearest = sdf.query(pushed)
    before = nearest.distance.numpy().copy()
    for _ in range(_PUSHES):
        inside = nearest.distance < CLEARANCE * 0.9
        if not inside.any():
            break
        pushed[inside] = nearest.closest[inside] + CLEARANCE * nearest.direction[inside]
        nearest = sdf.query(pushed)
    return pushed.numpy(), before, nearest.distance.numpy()


def measure(
    template: Mesh,
    vertices: np.ndarray,
    body: np.ndarray,
    body_faces: np.ndarray,
    *,
    rest: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
    fps: float,
) -> Quality:
    """Measure a clip.

    Args:
        template: the rest shape, as it is put on. vertices: (T, N, 3) metres. body: (T, B, 3). body_faces: (G, 3).
        rest: (B, 3) the body when the garment is put on.
        before, after: (T, N) signed distances to the body before and after `push_out`.
    """
    if not np.isfinite(vertices).all():
        return Quality(*[np.inf] * len(fields(Quality)))
    stretch = edge_lengths(vertices, template.edges) / edge_lengths(template.vertices, template.edges)

    def speed(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=1, initial=0.0) * fps

    return Quality(
        median_stretch=float(np.abs(np.median(stretch, axis=1) - 1).max()),
        p99_stretch=float(np.percentile(stretch, 99)),
        worst_p99_stretch=float(np.percentile(stretch, 99, axis=1).max()),
        sunk_percent=float(100 * (before < 0).mean()),
        deepest=float(max(0.0, -before.min())),
        penetration_percent=float(100 * (after < 0).mean()),
        speed=float(max(0.0, (speed(vertices) - speed(body)).max(initial=0.0))),
        reach=float(after.max()),
        energy_spike=energy_spike(template, vertices, fps),
        jitter=jitter(vertices, body, fps),
        slip=slip(template, vertices, rest, body),
        crossing_percent=100
        * float(body_crossing_fractions(vertices, template.faces, body, body_faces).mean()),
        self_crossing_percent=100 * float(self_crossing_fractions(vertices, template.faces).mean()),
    )


def energy_spike(template: Mesh, vertices: np.ndarray, fps: float) -> float:
    """How much more kinetic energy the cloth has in one frame than in those around it; 1 where nothing moves.

    Energy per mass, of velocities apart from the whole cloth's mean: what explodes or snaps for a frame or two stands
    out against the median of seven frames, which a movement of the body, however fast, raises with it. Energy below
    that of 0.5 m/s counts as this much.

    Args:
        vertices: (T, N, 3) metres.
    """
    if len(vertices) < 2:
        return 1.0
    mass = area_fractions(template.vertices, template.faces)
    velocity = np.diff(vertices, axis=0) * fps
    velocity = velocity - np.einsum("n,tnk->tk", mass, velocity)[:, None]
    energy = np.maximum(0.5 * np.einsum("n,tnk->t", mass, velocity**2), 0.5 * _SLOW_CLOTH**2)
    return float((energy / median_filter(energy, size=min(7, len(energy)), mode="nearest")).max())


def jitter(vertices: np.ndarray, body: np.ndarray, fps: float) -> float:
    """How far vertices shake while the body rests, metres: 0 where it never does.

    The 95th percentile, over vertices and frames that lie between resting ones, of the distance to the middle of where
    the vertex is a frame earlier and later.

    Args:
        vertices: (T, N, 3) metres. body: (T, B, 3).
    """
    still = np.linalg.norm(np.diff(body, axis=0), axis=-1).max(axis=1, initial=0.0) * fps < _STILL_BODY
    between = np.flatnonzero(still[:-1] & still[1:]) + 1
    if not len(between):
        return 0.0
    middle = (vertices[between - 1] + vertices[between + 1]) / 2
    return float(np.percentile(np.linalg.norm(vertices[between] - middle, axis=-1), 95))


def faults(quality: Quality, gates: GateConfig) -> list[str]:
    """What is wrong with a clip, one text a gate; empty where it may be used."""
    failed = []
    for name, limit in gates.model_dump().items():
        value = getattr(quality, name)
        if not value <= limit:
            failed.append(f"{name} is {value:.3g}, at most {limit:g} allowed")
    return failed
