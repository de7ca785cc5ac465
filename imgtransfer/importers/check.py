"""What is wrong with a garment and a body, in the words of who made them, before any work is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fusion import BodySdf
from imgtransfer.data.clip import Clip
from imgtransfer.importers.axes import AXES, UNITS, Axes, guess_axes, likely_unit
from imgtransfer.importers.weld import seam_groups
from render import InputError, Mesh, vertex_normals

Kind = Literal["unit", "axes", "apart", "inside", "inside_out", "seams", "pieces", "unused", "edges"]
Say = Callable[[str, str], str]  # an option's name and value -> what messages call it
DEEP = 0.005  # metres inside the body from which on a garment cannot be worn as it is


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong. `text` says what and how to mend it; `severe` stops the work unless told otherwise."""

    kind: Kind
    text: str
    severe: bool


def as_flag(name: str, value: str) -> str:
    """An option as the command line has it; those without a value are switches."""
    return f"--{name}={value}" if value else f"--{name}"


def check_template(
    garment: Mesh,
    body: Mesh,
    *,
    given: Axes | None = None,
    garment_given: Axes | None = None,
    welding: bool = False,
    say: Say = as_flag,
) -> list[Finding]:
    """Check a garment and the body that it is to be worn by, both in the rest pose.

    Args:
        garment: metres, y up, facing +z.
        body: likewise.
        given: how the body's file was turned into our axes and units, for messages that name the flags; None where
            it was taken as it is.
        garment_given: likewise the garment's file; None where it was turned as the body's.
        welding: whether seams will be welded, so that they are no fault.
        say: how messages name an option and its value.

    Returns:
        What is wrong, the most basic first; the place of the garment is looked at only where size and axes fit.
    """
    given = given or Axes()
    garment_given = garment_given or given
    found = [*_size(garment, body, given, garment_given, say), *_axes(body, given)]
    if not found:
        found += _place(garment, body, garment_given, say)
    return found + check_topology(garment, welding=welding, say=say)


def refuse(
    findings: Sequence[Finding], *, anyway: bool = False, hint: str = " (--anyway goes on all the same)"
) -> list[str]:
    """Stop at severe findings.

    Args:
        anyway: go on all the same. hint: what the message ends with.

    Returns:
        The texts of what does not stop the work, for the user to read.

    Raises:
        InputError: something severe; the message has all of it.
    """
    severe = [] if anyway else [finding.text for finding in findings if finding.severe]
    if severe:
        raise InputError(f"{'; '.join(severe)}{hint}")
    return [finding.text for finding in findings]


def _size(garment: Mesh, body: Mesh, given: Axes, garment_given: Axes, say: Say) -> list[Finding]:
    """Whether the body is of human size, and the garment fits its size."""
    size, cloth = (float(np.ptp(mesh.vertices, axis=0).max()) for mesh in (body, garment))
    if not 0.4 <= size <= 2.8:
        unit = likely_unit(size / given.scale)
        hint = (
            f"its file seems to be in {unit}: add --unit={unit}"
            if unit
            else "give its unit by --scale METRES"
        )
        return [
            Finding(
                "unit",
                f"{body.source}: the body would be {size:.3g} m large, a person is 0.4 to 2.8 m; {hint}",
                True,
            )
        ]
    for times in (1e-3, 1e-2, 1e-1, 1e1, 1e2, 1e3):
        if not 0.05 <= cloth / size <= 3 and 0.1 <= times * cloth / size <= 1.5:
            metres = garment_given.scale * times
            unit = next((name for name, value in UNITS.items() if np.isclose(value, metres)), None)
            hint = f": add {say('garment-unit', unit)}" if unit else ""
            text = f"{garment.source}: the garment would be {cloth:.3g} m large on a body of {size:.3g} m; "
            return [Finding("unit", f"{text}its file is in other units than the body's{hint}", True)]
    return []


def _axes(body: Mesh, given: Axes) -> list[Finding]:
    """Whether the body stands upright and faces +z, where its shape tells."""
    guessed = guess_axes(body.vertices @ given.rotation)  # back in the file's axes
    if guessed is None or (guessed.up, guessed.facing) == (given.up, given.facing):
        return []
    text = f"{body.source}: the body stands along {guessed.up} and faces {guessed.facing}"
    return [Finding("axes", f"{text}, not {given.up} and {given.facing}; add {guessed}", True)]


def _place(garment: Mesh, body: Mesh, garment_given: Axes, say: Say) -> list[Finding]:
    """Whether the garment is on the body, outside of it, and not inside out."""
    if _volume(body) < 0:
        text = f"{body.source}: the body's triangles are seen from inside (or its axes are left-handed)"
        return [Finding("inside_out", f"{text}; export it with outward faces and right-handed axes", True)]
    sdf = BodySdf(body.faces, len(body.vertices))
    sdf.update(body.vertices)
    points = torch.from_numpy(garment.vertices)
    query = sdf.query(points)
    distance = query.distance.double().numpy()
    found = []
    if distance.min() > 0.1 or np.median(distance) > 0.4:
        offset = (
            body.vertices.min(0) + body.vertices.max(0) - garment.vertices.min(0) - garment.vertices.max(0)
        ) / 2
        way = ", ".join(f"{value:+.2f}" for value in offset)
        text = f"{garment.source}: the garment is not on the body in the rest pose: its nearest vertex is "
        text += f"{distance.min():.2f} m away, the middle of the body lies by ({way}) m from its middle"
        hint = _turn(garment, sdf, garment_given, say) or "export both from the same scene in the same pose"
        return [Finding("apart", f"{text}; {hint}", True)]
    inside = distance < 0
    if inside.any():
        deepest = -float(distance.min())
        text = (
            f"{garment.source}: {inside.sum()} of {len(inside)} vertices start inside the body, the deepest "
        )
        hint = _turn(garment, sdf, garment_given, say) if deepest > DEEP else ""
        text += (
            f"{1000 * deepest:.1f} mm; {hint or 'move them out, or export garment and body in the same pose'}"
        )
        found.append(Finding("inside", text, bool(deepest > DEEP)))
    normals = vertex_normals(points, torch.from_numpy(garment.faces))
    outward = ((normals * query.direction.double()).sum(-1) > 0).double()
    if float(outward.mean()) < 0.3:
        text = f"{garment.source}: the garment's triangles are seen from inside; flip its normals and export again"
        found.append(Finding("inside_out", text, True))
    return found


def _turn(garment: Mesh, sdf: BodySdf, given: Axes, say: Say) -> str:
    """The options by which the garment would lie on the body, if its axes are what is wrong; else ""."""
    points = garment.vertices[:: max(1, len(garment.vertices) // 500)] @ given.rotation  # in the file's axes
    fitting = []
    for up, facing in product(AXES, AXES):
        if up[-1] == facing[-1] or (up, facing) == (given.up, given.facing):
            continue
        distance = sdf.distance(torch.from_numpy(points @ Axes(up, facing).rotation.T)).numpy()
        if np.median(distance) < 0.12 and (distance < -DEEP).mean() < 0.02:
            options = f"{say('garment-up', up)} {say('garment-facing', facing)}"
            fitting.append((float(np.abs(distance).mean()), options))
    return f"its axes are other ones than the body's: add {min(fitting)[1]}" if fitting else ""


def check_worn(clip: Clip, source: str, *, hint: str) -> None:
    """Check that the garment is on the body in the first, middle and last frame.

    Args:
        source: what the message calls the clip. hint: what the user may look at.

    Raises:
        InputError: it is beside the body, or most of it inside.
    """
    if clip.garment_vertices is None:
        return
    sdf = BodySdf(clip.body_faces, len(clip.body_rest))
    for frame in sorted({0, clip.n_frames // 2, clip.n_frames - 1}):
        sdf.update(clip.body_vertices[frame])
        distance = sdf.distance(torch.from_numpy(clip.garment_vertices[frame])).numpy()
        inside, apart = float((distance < -0.001).mean()), float(np.median(distance))
        if inside > 0.5 or apart > 0.4:
            what = (
                f"{100 * inside:.0f} % of it inside"
                if inside > 0.5
                else f"half of it more than {apart:.2f} m away"
            )
            raise InputError(f"{source}: the garment is not on the body in frame {frame}, {what}; {hint}")


def _volume(mesh: Mesh) -> float:
    """Signed volume, positive where triangles are counter-clockwise from outside."""
    a, b, c = np.moveaxis((mesh.vertices - mesh.vertices.mean(0))[mesh.faces], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def check_topology(garment: Mesh, *, welding: bool = False, say: Say = as_flag) -> list[Finding]:
    """Check a garment's connectivity: seams that were split, loose pieces, vertices and edges that do no work.

    Args:
        garment: metres. welding: whether seams will be welded, so that they are no fault.
        say: how messages name an option and its value.
    """
    found = []
    first, count = seam_groups(garment), len(garment.vertices)
    joined = count - len(np.unique(first))
    if joined and not welding:
        text = f"{garment.source}: {joined} of {count} vertices lie on others, where seams were split (by texture "
        text += f"coordinates or panels); cloth would come apart there: add {say('weld', '')}"
        found.append(Finding("seams", text, True))
    faces = first[garment.faces]
    used = np.zeros(count, bool)
    used[garment.faces] = True
    pieces = _pieces(faces, count, np.unique(faces))
    if len(pieces) > 1:
        sizes = ", ".join(str(size) for size in pieces[:5]) + (" ..." if len(pieces) > 5 else "")
        text = f"{garment.source}: {len(pieces)} separate pieces ({sizes} vertices); they are taken as one garment"
        found.append(Finding("pieces", text, False))
    if not used.all():
        text = f"{garment.source}: {(~used).sum()} vertices belong to no triangle (vertex {int(np.argmin(used))} first)"
        found.append(Finding("unused", f"{text}; nothing can be recovered for them: delete them", False))
    halves = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(halves[halves[:, 0] != halves[:, 1]], axis=0, return_counts=True)
    if (uses > 2).any():
        text = (
            f"{garment.source}: {(uses > 2).sum()} edges have three or more triangles; cloth has one or two"
        )
        found.append(Finding("edges", text, False))
    return found


def _pieces(faces: np.ndarray, count: int, used: np.ndarray) -> list[int]:
    """Sizes of the connected pieces, in vertices, largest first; vertices without triangles are left out."""
    start, end = faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel()
    _, label = connected_components(
        coo_array((np.ones(len(start)), (start, end)), shape=(count, count)), directed=False
    )
    return sorted(np.bincount(label[used]).tolist(), reverse=True)[: len(np.unique(label[used]))]
