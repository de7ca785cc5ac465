"""What a clip does frame by frame, and what of it looks wrong: simulation and capture go wrong in known ways."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import torch
from scipy.spatial import cKDTree

from fusion import BodySdf
from fusion.obstacles import body_crossing_fractions, self_crossing_fractions
from imgtransfer.data.clip import Clip
from render import Mesh
from render.mesh.measures import edge_lengths

SAMPLED_FRAMES = 24  # frames in which distances to the body are measured
_BLOCK = 64  # frames measured at once, which bounds memory

# Beyond these a clip is named; the first four are as the gates of the simulation, or tighter.
STRETCHED = 0.6  # |l / l₀ - 1| at the 99th percentile of a frame's edges
OVERSTRETCHED = 3.0  # |l / l₀ - 1| of any edge
INSIDE_PERCENT = 2.0  # of the vertices, in one frame
CROSSING_PERCENT = 1.0  # of the edges, in one frame
FASTER_THAN_BODY = 4.0  # m/s
SPIKE = 4.0  # times the median speed of the frames around, and
SPIKE_SPEED = 1.5  # m/s more than it, and more than the body
BODY_SPEED = 15.0  # m/s, faster than hands and feet in sport
JITTER_MM = 0.5  # mean second difference of vertices while the body rests
RESTING = 0.05  # m/s, of the fastest point of the body
FAR = 0.6  # metres from the body
SLID = 0.2  # metres, median change of the distances between vertices and the skin that is closest in the rest pose
TEMPLATE_INSIDE_PERCENT = 1.0
TEMPLATE_NEAR = 0.15  # metres, median distance of the template to the resting body
SIZE_RATIO = (0.05, 3.0)  # height of the garment over that of the body


@dataclass(frozen=True)
class ClipFinding:
    """Something that looks wrong: a line of text, and the frame that shows it best, if there is one."""

    text: str
    frame: int | None = None


@dataclass(frozen=True, eq=False)
class Inspection:
    """A clip measured.

    Args:
        name, fps, frames: of the clip.
        strain: (T, 3) per cent: median, 99th percentile and maximum of |l / l₀ - 1| over the edges.
        speed: (T - 1, 2) m/s: of the fastest vertex of the garment and of the body, between frames.
        sampled: (S,) frames in which distances to the body were measured.
        inside: (S,) per cent of the vertices inside the body. farthest: (S,) metres to the body.
        crossing: (S,) edges that pass through a face of the other, of garment and body, in per cent of the garment's.
        self_crossing: (S,) per cent of the garment's edges that pass through its own faces.
        slid: (S,) metres, median change of the distance between vertices and the skin closest in the rest pose.
        jitter_mm: mean length of the second difference of the garment while the body rests; None where it never does.
        findings: what looks wrong, the gravest first.

    Without a garment all arrays are empty.
    """

    name: str
    fps: float
    frames: int
    strain: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    speed: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    sampled: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    inside: np.ndarray = field(default_factory=lambda: np.zeros(0))
    farthest: np.ndarray = field(default_factory=lambda: np.zeros(0))
    crossing: np.ndarray = field(default_factory=lambda: np.zeros(0))
    self_crossing: np.ndarray = field(default_factory=lambda: np.zeros(0))
    slid: np.ndarray = field(default_factory=lambda: np.zeros(0))
    jitter_mm: float | None = None
    findings: tuple[ClipFinding, ...] = ()


def inspect_clip(clip: Clip) -> Inspection:
    """Measure every frame of a clip (distances to the body in `SAMPLED_FRAMES` of them) and judge it."""
    template = _template_findings(clip)
    if clip.garment is None:
        return Inspection(clip.name, clip.fps, clip.n_frames, findings=tuple(template))
    strain = _strain(clip)
    garment = _speed(clip.garment.vertices, clip.fps)
    body = _speed(clip.body.vertices, clip.fps)
    sampled = np.unique(np.linspace(0, clip.n_frames - 1, SAMPLED_FRAMES).round().astype(int))
    inside, farthest, slid = _distances(clip, sampled)
    cloth, skin, faces = clip.garment.vertices[sampled], clip.body.vertices[sampled], clip.template.faces
    crossing = 100 * body_crossing_fractions(cloth, faces, skin, clip.body.faces)
    jitter, jittery = _jitter(clip.garment.vertices, body)
    findings = [
        *_strain_findings(strain),
        *_distance_findings(sampled, inside, farthest, slid),
        *_crossing_findings(sampled, crossing),
        *_speed_findings(garment, body),
        *template,
    ]
    if jitter is not None and jitter > JITTER_MM:
        findings.append(ClipFinding(f"jitters by {jitter:.2f} mm a frame while the body rests", jittery))
    repeated = np.flatnonzero((garment == 0) & (body > RESTING))
    if len(repeated):
        text = f"{len(repeated)} frames repeat the garment of the frame before while the body moves"
        findings.append(ClipFinding(text, int(repeated[0]) + 1))
    return Inspection(
        clip.name,
        clip.fps,
        clip.n_frames,
        strain=100 * strain,
        speed=np.stack([garment, body], axis=-1),
        sampled=sampled,
        inside=inside,
        crossing=crossing,
        self_crossing=100 * self_crossing_fractions(cloth, faces),
        farthest=farthest,
        slid=slid,
        jitter_mm=jitter,
        findings=tuple(findings),
    )


def _strain(clip: Clip) -> np.ndarray:
    """(T, 3): median, 99th percentile and maximum of |l / l₀ - 1|; edges without a length are left out."""
    assert clip.garment is not None
    edges = Mesh(clip.template.vertices, clip.template.faces, clip.name).edges
    rest = edge_lengths(clip.template.vertices, edges)
    rows = []
    for start in range(0, clip.n_frames, _BLOCK):
        stretched = edge_lengths(clip.garment.vertices[start : start + _BLOCK], edges)[..., rest > 0]
        rows.append(np.percentile(np.abs(stretched / rest[rest > 0] - 1), (50, 99, 100), axis=-1).T)
    return np.concatenate(rows) if rest.any() else np.zeros((clip.n_frames, 3))


def _speed(vertices: np.ndarray, fps: float) -> np.ndarray:
    """(T - 1,) m/s of the fastest vertex between frames."""
    moves = [np.linalg.norm(b - a, axis=-1).max() for a, b in pairwise(vertices)]
    return np.array(moves, float) * fps


def _distances(clip: Clip, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`inside`, `farthest` and `slid` of `Inspection`, for the frames."""
    assert clip.garment is not None
    sdf = BodySdf(clip.body.faces, clip.body.vertices.shape[1])
    hung, skin = cKDTree(clip.body.rest).query(clip.template.vertices)
    rows = []
    for frame in frames:
        garment, body = clip.garment.vertices[frame], clip.body.vertices[frame]
        distance = _signed(sdf, body, garment)
        away = np.linalg.norm(garment - body[skin], axis=-1)
        rows.append((100 * (distance < 0).mean(), distance.max(), np.median(np.abs(away - hung))))
    inside, farthest, slid = np.array(rows, float).T
    return inside, farthest, slid


def _signed(sdf: BodySdf, body: np.ndarray, points: np.ndarray) -> np.ndarray:
    sdf.update(np.ascontiguousarray(body, np.float32))
    return sdf.query(torch.from_numpy(np.ascontiguousarray(points, np.float32))).distance.numpy()


def _jitter(garment: np.ndarray, body_speed: np.ndarray) -> tuple[float | None, int | None]:
    """Mean second difference (mm) over the frames at which the body rests before and after, and the worst one."""
    resting = np.flatnonzero((body_speed[:-1] < RESTING) & (body_speed[1:] < RESTING)) + 1
    if len(resting) == 0:
        return None, None
    jolts = [
        float(np.linalg.norm(garment[t - 1] - 2 * garment[t] + garment[t + 1], axis=-1).mean())
        for t in resting
    ]
    return 1000 * float(np.mean(jolts)), int(resting[int(np.argmax(jolts))])


def _strain_findings(strain: np.ndarray) -> list[ClipFinding]:
    findings = []
    worst = int(strain[:, 1].argmax())
    if strain[worst, 1] > STRETCHED:
        text = f"1 % of the edges are stretched or pressed by more than {100 * strain[worst, 1]:.0f} %"
        findings.append(ClipFinding(f"{text} in frame {worst}", worst))
    worst = int(strain[:, 2].argmax())
    if strain[worst, 2] > OVERSTRETCHED:
        findings.append(
            ClipFinding(f"an edge is {1 + strain[worst, 2]:.1f} times as long in frame {worst}", worst)
        )
    return findings


def _distance_findings(
    frames: np.ndarray, inside: np.ndarray, farthest: np.ndarray, slid: np.ndarray
) -> list[ClipFinding]:
    findings = []
    worst = int(slid.argmax())
    if slid[worst] > SLID:
        text = f"the garment has slid: half of it by more than {slid[worst]:.2f} m in frame {frames[worst]}"
        findings.append(ClipFinding(text, int(frames[worst])))
    worst = int(inside.argmax())
    if inside[worst] > INSIDE_PERCENT:
        text = f"{inside[worst]:.1f} % of the vertices are inside the body in frame {frames[worst]}"
        findings.append(ClipFinding(text, int(frames[worst])))
    worst = int(farthest.argmax())
    if farthest[worst] > FAR:
        text = f"the garment reaches {farthest[worst]:.2f} m from the body in frame {frames[worst]}"
        findings.append(ClipFinding(f"{text}: it may have slipped off", int(frames[worst])))
    return findings


def _crossing_findings(frames: np.ndarray, crossing: np.ndarray) -> list[ClipFinding]:
    worst = int(crossing.argmax())
    if crossing[worst] <= CROSSING_PERCENT:
        return []
    text = (
        f"edges of cloth and body, {crossing[worst]:.1f} % of the garment's, pass through the other in frame"
    )
    return [ClipFinding(f"{text} {frames[worst]}", int(frames[worst]))]


def _speed_findings(garment: np.ndarray, body: np.ndarray) -> list[ClipFinding]:
    findings: list[ClipFinding] = []
    if len(garment) == 0:
        return findings
    over = garment - body
    worst = int(over.argmax())
    if over[worst] > FASTER_THAN_BODY:
        text = f"a vertex is {over[worst]:.1f} m/s faster than the body before frame {worst + 1}"
        findings.append(ClipFinding(text, worst + 1))
    around = np.array([np.median(garment[max(0, t - 3) : t + 4]) for t in range(len(garment))])
    spikes = (garment > SPIKE * around) & (garment > np.maximum(around, body) + SPIKE_SPEED)
    if spikes.any():
        first = int(spikes.argmax())
        text = f"{int(spikes.sum())} sudden jumps of the garment, the first before frame {first + 1}"
        findings.append(ClipFinding(text, first + 1))
    worst = int(body.argmax())
    if body[worst] > BODY_SPEED:
        text = f"the body moves at {body[worst]:.0f} m/s before frame {worst + 1}: a fault of the motion"
        findings.append(ClipFinding(text, worst + 1))
    return findings


def _template_findings(clip: Clip) -> list[ClipFinding]:
    """What is wrong with the meshes in the rest pose."""
    findings = []
    template, faces = clip.template.vertices, clip.template.faces
    heights = [float(np.ptp(points[:, 1])) for points in (template, clip.body.rest)]
    ratio = heights[0] / heights[1] if heights[1] else np.inf
    if not SIZE_RATIO[0] < ratio < SIZE_RATIO[1]:
        text = f"the template is {heights[0]:.3g} m high, the body {heights[1]:.3g} m: other units?"
        findings.append(ClipFinding(text))
    distance = _signed(BodySdf(clip.body.faces, len(clip.body.rest)), clip.body.rest, template)
    inside = 100 * float((distance < 0).mean())
    if inside > TEMPLATE_INSIDE_PERCENT:
        findings.append(ClipFinding(f"{inside:.1f} % of the template's vertices are inside the resting body"))
    away = float(np.median(np.abs(distance)))
    if away > TEMPLATE_NEAR:
        text = f"the template is {away:.2f} m from the resting body: not in the same place?"
        findings.append(ClipFinding(text))
    unused = len(template) - len(np.unique(faces))
    if unused:
        findings.append(ClipFinding(f"{unused} of the template's vertices belong to no face"))
    twice = len(template) - len(np.unique(template, axis=0))
    if twice:
        findings.append(
            ClipFinding(f"{twice} of the template's vertices stand where another does: unwelded seams?")
        )
    return findings
