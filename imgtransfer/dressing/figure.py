"""A body in motion that wears a garment: what a network needs to move the garment, too."""

from __future__ import annotations

import logging

import numpy as np

from imgtransfer.bodies.config import AnnyConfig, make_body
from imgtransfer.data.clip_parts import Template
from imgtransfer.data.reader import Reader
from imgtransfer.dressing.hanging import hanging_garment, ships
from imgtransfer.dressing.readers import MeshReader, PosedReader
from imgtransfer.dressing.settling import settled_garment
from imgtransfer.dressing.source import Source, needs_own_garment
from imgtransfer.garments.config import GarmentConfig, TemplateConfig
from imgtransfer.garments.garment import resting, template_garment
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.sequences import weld_sequence
from imgtransfer.motions.motion import Motion
from imgtransfer.simulation.config import SimulateConfig
from render import Mesh
from render.extras import check_installed
from render.threads import one_blas_thread

_log = logging.getLogger(__name__)


@one_blas_thread()
def figure_of(source: Source, config: SimulateConfig) -> Reader:
    """The source's body with the configuration's garment, as a clip whose frames are made when they are asked for.

    A garment of the project's lies as it hangs on the resting body; the user's own mesh as its file has it.

    Args:
        source: a motion of the configuration's body, or a body of its own.
        config: of one garment and one body; what concerns cloth matters only where a garment has to be made.

    Raises:
        InputError: a body's or a garment's file that cannot be read, a garment that does not fit the body, or one that
            cannot be made for it.
    """
    garment = config.garment
    name = f"{garment.title}/{source.name}"
    if isinstance(source.moved, Motion):
        body = make_body(config.body)
        info = {"source": f"imgtransfer dress, motion {source.name}"}
        return PosedReader(
            name=name,
            template=_on_body(config),
            body=body,
            motion=source.moved,
            frames=source.frames,
            fps=source.fps,
            info=info | {"body": config.body.model_dump_json(exclude_unset=True)},
        )
    if not isinstance(garment, TemplateConfig):
        raise needs_own_garment(garment, source)
    opened = source.moved.open()
    moving = weld_sequence(opened.sequence) if source.moved.settings.weld else opened.sequence
    chosen = moving.selected(slice(source.frames.start, source.frames.stop, source.frames.step))
    return MeshReader(
        name=name,
        template=_template(_own(garment, moving.mesh, opened.axes)),
        body=chosen,
        fps=source.fps,
        info={"source": f"imgtransfer dress, body mesh sequence {source.name}"},
    )


def _on_body(config: SimulateConfig) -> Template:
    """The garment at rest on the configuration's body."""
    garment, body = config.garment, config.body
    if isinstance(garment, TemplateConfig):
        return _template(_own(garment, resting(make_body(body)), None))
    if isinstance(body, AnnyConfig) and ships(garment, body):
        return _template(hanging_garment(garment, body))
    check_installed("simulate", f"cutting a {garment.kind} for this body", "gpytoolbox", "newton")
    pattern, settled = settled_garment(config)
    return Template(settled, pattern.faces.astype(np.int32))


def _own(garment: GarmentConfig, body: Mesh, axes: Axes | None) -> Mesh:
    """The user's garment; what is odd about it, but no obstacle, is logged."""
    assert isinstance(garment, TemplateConfig)
    made, notes = template_garment(body, garment, body_axes=axes)
    for text in notes:
        _log.warning("note: %s", text)
    return made.mesh


def _template(mesh: Mesh) -> Template:
    return Template(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), mesh.surface)
