"""A garment that was put on the resting body, as it hangs there: gravity and the body's contact, until it rests.

Patterns stand off the body where they were cut to, and templates of other simulators are often such patterns. A model
of many garments is trained on templates that hang, so that what it predicts is the motion's doing and not the fall.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.grid import round_to_grid
from imgtransfer.garments.cutting import border_loops
from imgtransfer.garments.garment import Garment
from imgtransfer.importers.checks.weld import weld
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.simulation.body_motion.dressed_body import DressedBody, settled
from imgtransfer.simulation.body_motion.skin import covered_skin
from imgtransfer.simulation.config import ClothConfig, GateConfig, SolverConfig
from imgtransfer.simulation.slip import slip
from render import InputError, Mesh, Option
from render.extras import check_installed
from render.mesh.measures import edge_lengths
from render.threads import one_blas_thread

_log = logging.getLogger(__name__)
_FPS = 30.0  # steps of which velocities are damped
_SLIDES = 0.06  # metres that a top opening slips and a note says so; necks that hold have at most 4 cm
_SOLVER = SolverConfig(self_contact=True)  # as the templates hang that the general checkpoint knows


def hanging_template(clip: Clip, *, pinned: bool = False, anyway: bool = False) -> np.ndarray:
    """A clip's template as it hangs on the clip's resting body, cotton; once a process for clips of one outfit.

    Args:
        clip: any of its frames. pinned, anyway: see `hanging`.

    Returns:
        (N, 3) float32 metres.

    Raises:
        InputError: see `hanging`; or the extra `simulate` is missing.
    """
    check_installed("simulate", "letting a template hang", "newton")
    arrays = (clip.template.vertices, clip.template.faces, clip.body.rest, clip.body.faces)
    content = fingerprint(np.ascontiguousarray(array).data for array in arrays)
    template = Mesh(clip.template.vertices.astype(np.float64), clip.template.faces, clip.name)
    return _hanging(_Outfit(content, template, Mesh(clip.body.rest, clip.body.faces)), pinned, anyway)


@dataclass(frozen=True)
class _Outfit:
    """A template and a resting body, known by their content."""

    content: str
    template: Mesh = field(compare=False)
    body: Mesh = field(compare=False)


@lru_cache(maxsize=8)
def _hanging(outfit: _Outfit, pinned: bool, anyway: bool) -> np.ndarray:
    return hanging(outfit.template, outfit.body, ClothConfig(), pinned=pinned, anyway=anyway)


@one_blas_thread()
def hanging(
    template: Mesh, body: Mesh, cloth: ClothConfig, *, pinned: bool = False, anyway: bool = False
) -> np.ndarray:
    """The template as it hangs on the resting body after `SolverConfig.settle_seconds` of simulation.

    Vertices of split seams, which lie on each other at open edges, move together.

    Args:
        template: (N, 3) metres, put on the body without touching it much. body: at rest, metres.
        cloth: its material; the rest shape is the template itself.
        pinned: whether the topmost opening is a waistband, which stays on the skin.
        anyway: only note that it slips off or is stretched, such as a hood that is meant to fall back.

    Returns:
        (N, 3) float32 metres, on the 2⁻¹⁶ m grid.

    Raises:
        InputError: `pinned` without an opening, or a template that tears or slips off.
    """
    welded = weld(Mesh(template.vertices, template.faces, template.source))
    sewn = welded.mesh
    loops = sorted(border_loops(sewn.faces), key=lambda loop: sewn.vertices[loop, 1].mean())
    if pinned and not loops:
        raise InputError(
            f"{template.source}: the mesh has no opening that could be a waistband; leave out {Option('pinned')}"
        )
    waist = np.sort(loops[-1]) if pinned else np.zeros(0, np.int64)
    rest = body.vertices.astype(np.float32)
    dressed = DressedBody(
        rest,
        body.faces.astype(np.int32),
        Garment("template", sewn, {}, waist),
        covered_skin(sewn.vertices, rest),
    )
    hangs = settled(dressed, cloth, _SOLVER, _FPS)
    _check(sewn, hangs, rest, anyway=anyway)
    moved = 1000 * np.linalg.norm(hangs - sewn.vertices, axis=-1).mean()
    _log.info("%s: hangs %.1f mm, in the mean, from where it was put on", template.source, moved)
    assert sewn.surface is not None
    return round_to_grid(hangs[sewn.surface.vertices])


def _check(sewn: Mesh, hangs: np.ndarray, rest: np.ndarray, *, anyway: bool) -> None:
    gates = GateConfig()
    if not np.isfinite(hangs).all():
        raise InputError(
            f"{sewn.source}: the cloth came apart while it was let hang; is it in metres, and on the body?"
        )
    slipped = slip(sewn, hangs[None], rest, rest[None])
    if slipped > gates.slip:
        _object(
            f"{sewn.source}: the garment's topmost opening slips {100 * slipped:.0f} cm down the resting body; with "
            f"{Option('pinned', True)} it is a waistband, which stays on the skin",
            anyway=anyway,
        )
    elif slipped > _SLIDES:
        _log.warning(
            "note: %s: the garment's topmost opening has come down by %.0f cm over the body; where it is a waistband, "
            "%s holds it",
            sewn.source,
            100 * slipped,
            Option("pinned", True),
        )
    stretch = edge_lengths(hangs, sewn.edges) / edge_lengths(sewn.vertices, sewn.edges)
    if (worst := np.percentile(stretch, 99)) > gates.worst_p99_stretch:
        _object(
            f"{sewn.source}: one edge in a hundred is stretched to {worst:.1f} times its length where the garment is "
            "let hang; it lies in the body or is too small for it",
            anyway=anyway,
        )


def _object(text: str, *, anyway: bool) -> None:
    """Refuse what went wrong, or note it."""
    if not anyway:
        raise InputError(f"{text} ({Option('anyway', True)} goes on all the same)")
    _log.warning("note: %s", text)
