"""Whether two figures, a garment on a body at rest, are the same one in two shapes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from imgtransfer.data.clip import Clip
from render import InputError, Mesh, Option
from render.mesh.rigid import rigid_rotation

SAME_M = 1e-5  # vertices that are this near are the same
# How far a shape may be from the reference: wider than people's shapes, narrower than mistakes such as other units,
# another up axis, or a rest pose that stands elsewhere.
_SCALE = 1.6  # of the garment, either way
_TURN_DEGREES = 20.0
_LEVEL_M = 0.08  # sideways and to the front; people stand over the same place
_HEIGHT_M = 0.5  # up and down; people are of different height
_MISFIT = 0.15  # of the garment's radius: what no affine map explains
_OFF_BODY_M = 0.05  # between garment and body, mean


def same_faces(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two lists of faces (F, 3) are one."""
    return a.shape == b.shape and np.array_equal(a, b)


def same_template(clip: Clip, template: Mesh) -> bool:
    """Whether the clip's garment is `template`, vertex by vertex to 1/100 mm."""
    return same_faces(clip.template.faces, template.faces) and np.allclose(
        clip.template.vertices, template.vertices, rtol=0, atol=SAME_M
    )


def as_it_hangs(clip: Clip, hangs: np.ndarray, general: bool, model: str) -> Clip:
    """The clip as a general model is shown it: with its template as that hangs on the resting body.

    Edge lengths stay those of the template itself, which a simulation stretches a little.

    Args:
        clip: with its template. hangs: (N, 3) metres (`imgtransfer.simulation.hang.hanging_template`).
        general, model: as of `check_hangs`.
    """
    check_hangs(general, model)
    return replace(clip, template=replace(clip.template, vertices=hangs.astype(np.float32)))


def check_hangs(general: bool, model: str) -> None:
    """Raise InputError unless a model, called `model` in messages, is `general` and so takes templates as they hang."""
    if not general:
        raise InputError(
            f"{model}: was trained on one garment and knows its template as it is; leave out "
            f"{Option('settle', True)}, which is for models of many garments"
        )


def check_clip(clip: Clip, template: Mesh, body: Mesh | None) -> None:
    """Raise InputError unless the clip's garment is a model's.

    It is if it has the same faces and lies where the model's does, vertex by vertex to 1/100 mm; or, on a body with the
    faces of the model's, if it may be the model's in another shape.

    Args:
        clip: to be predicted.
        template: the model's garment. body: its rest body; None for a model of one shape.
    """
    if same_template(clip, template):
        return
    mine = f"({len(clip.template.vertices)} vertices, {len(clip.template.faces)} faces)"
    refused = f"{clip.name}: its garment {mine} is not the model's ({len(template.vertices)}, {len(template.faces)})"
    if not same_faces(clip.template.faces, template.faces):
        raise InputError(f"{refused}; train a model on this garment")
    if body is None:
        raise InputError(f"{refused} in its one shape; a model trained anew is not bound to one")
    if not same_faces(clip.body.faces, body.faces):
        raise InputError(
            f"{refused} in its own shape, and its body is not the model's in another ({len(body.vertices)} "
            f"vertices wanted, found {len(clip.body.rest)}, or other faces)"
        )
    if fault := misfit(clip, template, body):
        raise InputError(f"{refused} in any shape: {fault} the model; train a model on this garment")


def misfit(clip: Clip, template: Mesh, body: Mesh) -> str | None:
    """Why the clip's garment and rest body cannot be those of a reference in another shape.

    Another garment with the same faces cannot be told from another shape of the same; what can be told is what does
    not look like people of different shapes.

    Args:
        clip: with the faces of the reference.
        template: the reference's garment. body: its rest body, in the same frame.

    Returns:
        a phrase that goes before the reference's name; None where nothing is wrong.
    """
    mine, reference = clip.template.vertices.astype(np.float64), template.vertices
    scale, turn = _similarity(reference, mine)
    shift = mine.mean(0) - reference.mean(0)
    left = _not_affine(reference, mine)
    radius = np.sqrt(np.square(reference - reference.mean(0)).sum(1).mean())
    if not 1 / _SCALE < scale < _SCALE:
        return f"its garment is {scale:.3g} times as large as that of"
    if turn > _TURN_DEGREES:
        return f"its garment is turned by {turn:.0f} degrees against that of"
    if left > _MISFIT * scale * radius:
        return f"its garment is another: {100 * left:.0f} cm off, after the best fit, from that of"
    if np.hypot(shift[0], shift[2]) > _LEVEL_M or abs(shift[1]) > _HEIGHT_M:
        return f"its garment lies {100 * np.linalg.norm(shift):.0f} cm away, at rest, from that of"
    nearest = cKDTree(body.vertices).query(reference)[1]
    apart = (mine - clip.body.rest[nearest]) - (reference - body.vertices[nearest])
    if np.linalg.norm(apart.mean(0)) > _OFF_BODY_M:
        off = 100 * np.linalg.norm(apart.mean(0))
        return f"its garment lies, on its body at rest, {off:.0f} cm off where it lies in"
    return None


def _similarity(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Scale, and angle of the rotation in degrees, that with a shift fit points (N, 3) best (Umeyama 1991)."""
    centred, target = before - before.mean(0), after - after.mean(0)
    rotation = rigid_rotation(before, after)
    scale = (target * (centred @ rotation.T)).sum() / max(np.square(centred).sum(), np.finfo(np.float64).tiny)
    return float(scale), float(np.degrees(Rotation.from_matrix(rotation).magnitude()))


def _not_affine(before: np.ndarray, after: np.ndarray) -> float:
    """How far the best affine map of points (N, 3) misses, root mean square, metres."""
    centred, target = before - before.mean(0), after - after.mean(0)
    left = target - centred @ np.linalg.lstsq(centred, target, rcond=None)[0]
    return float(np.sqrt(np.square(left).sum(1).mean()))
