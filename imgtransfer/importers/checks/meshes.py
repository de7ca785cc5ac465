"""What is wrong with a garment and a body, in the words of who made them, before any work is done."""

from __future__ import annotations

from itertools import product

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.importers.checks.axes import AXES, UNITS, Axes, guess_axes, likely_unit
from imgtransfer.importers.checks.findings import MeshFault
from imgtransfer.importers.checks.topology import check_topology, used_part
from render import Mesh, Option, vertex_normals
from render.mesh.measures import volume

DEEP = 0.005  # metres inside the body from which on a garment cannot be worn as it is


def check_template(
    garment: Mesh,
    body: Mesh,
    *,
    given: Axes | None = None,
    garment_given: Axes | None = None,
    welding: bool = False,
) -> list[MeshFault]:
    """Check a garment and the body that it is to be worn by, both in the rest pose.

    Args:
        garment: metres, y up, facing +z.
        body: likewise.
        given: how the body's file was turned into our axes and units, for messages that name the flags; None where
            it was taken as it is.
        garment_given: likewise the garment's file; None where it was turned as the body's.
        welding: whether seams will be welded, so that they are no fault.

    Returns:
        What is wrong, the most basic first; the place of the garment is looked at only where size and axes fit.
    """
    given = given or Axes()
    garment_given = garment_given or given
    cloth, skin = used_part(garment), used_part(body)
    found = [*_size(cloth, skin, given, garment_given), *_axes(skin, given)]
    if not found:
        found += _place(cloth, skin, garment_given)
    return found + check_topology(garment, welding=welding)


def _size(garment: Mesh, body: Mesh, given: Axes, garment_given: Axes) -> list[MeshFault]:
    """Whether the body is of human size, and the garment fits its size."""
    size, cloth = (float(np.ptp(mesh.vertices, axis=0).max()) for mesh in (body, garment))
    if not 0.4 <= size <= 2.8:
        unit = likely_unit(size / given.scale)
        hint = (
            f"its file seems to be in {unit}: add {Option('unit', unit)}"
            if unit
            else f"give its unit by {Option('scale')} METRES"
        )
        return [
            MeshFault(
                "unit",
                f"{body.source}: the body would be {size:.3g} m large, a person is 0.4 to 2.8 m; {hint}",
                True,
            )
        ]
    for times in (1e-3, 1e-2, 1e-1, 1e1, 1e2, 1e3):
        if not 0.05 <= cloth / size <= 3 and 0.1 <= times * cloth / size <= 1.5:
            metres = garment_given.scale * times
            unit = next((name for name, value in UNITS.items() if np.isclose(value, metres)), None)
            hint = f": add {Option('garment_unit', unit)}" if unit else ""
            text = f"{garment.source}: the garment would be {cloth:.3g} m large on a body of {size:.3g} m; "
            return [MeshFault("unit", f"{text}its file is in other units than the body's{hint}", True)]
    return []


def _axes(body: Mesh, given: Axes) -> list[MeshFault]:
    """Whether the body stands upright and faces +z, where its shape tells."""
    guessed = guess_axes(body.vertices @ given.rotation)  # back in the file's axes
    if guessed is None or (guessed.up, guessed.facing) == (given.up, given.facing):
        return []
    text = f"{body.source}: the body stands along {guessed.up} and faces {guessed.facing}"
    return [MeshFault("axes", f"{text}, not {given.up} and {given.facing}; add {guessed}", True)]


def _place(garment: Mesh, body: Mesh, garment_given: Axes) -> list[MeshFault]:
    """Whether the garment is on the body, outside of it, and not inside out."""
    if volume(body.vertices, body.faces) < 0:
        text = f"{body.source}: the body's triangles are seen from inside (or its axes are left-handed)"
        return [MeshFault("inside_out", f"{text}; export it with outward faces and right-handed axes", True)]
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
        hint = _turn(garment, sdf, garment_given) or "export both from the same scene in the same pose"
        return [MeshFault("apart", f"{text}; {hint}", True)]
    inside = distance < 0
    if inside.any():
        deepest = -float(distance.min())
        text = (
            f"{garment.source}: {inside.sum()} of {len(inside)} vertices start inside the body, the deepest "
        )
        hint = _turn(garment, sdf, garment_given) if deepest > DEEP else ""
        text += (
            f"{1000 * deepest:.1f} mm; {hint or 'move them out, or export garment and body in the same pose'}"
        )
        found.append(MeshFault("inside", text, bool(deepest > DEEP)))
    normals = vertex_normals(points, torch.from_numpy(garment.faces))
    outward = ((normals * query.direction.double()).sum(-1) > 0).double()
    if float(outward.mean()) < 0.3:
        text = f"{garment.source}: the garment's triangles are seen from inside; flip its normals and export again"
        found.append(MeshFault("inside_out", text, True))
    return found


def _turn(garment: Mesh, sdf: BodySdf, given: Axes) -> str:
    """The options by which the garment would lie on the body, if its axes are what is wrong; else ""."""
    points = garment.vertices[:: max(1, len(garment.vertices) // 500)] @ given.rotation  # in the file's axes
    fitting = []
    for up, facing in product(AXES, AXES):
        if up[-1] == facing[-1] or (up, facing) == (given.up, given.facing):
            continue
        distance = sdf.distance(torch.from_numpy(points @ Axes(up, facing).rotation.T)).numpy()
        if np.median(distance) < 0.12 and (distance < -DEEP).mean() < 0.02:
            options = f"{Option('garment_up', up)} {Option('garment_facing', facing)}"
            fitting.append((float(np.abs(distance).mean()), options))
    return f"its axes are other ones than the body's: add {min(fitting)[1]}" if fitting else ""
