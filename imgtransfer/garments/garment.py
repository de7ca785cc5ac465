"""A garment for a body: made from its rest mesh, or the user's own mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from fusion import BodySdf
from imgtransfer.bodies.skinned import SkinnedBody
from imgtransfer.garments.checks import mesh_quality
from imgtransfer.garments.config import (
    DressConfig,
    GarmentConfig,
    MadeConfig,
    SkirtConfig,
    TemplateConfig,
    TrousersConfig,
    TShirtConfig,
)
from imgtransfer.garments.cutting import border_loops
from imgtransfer.garments.field import Field
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.lower import lower_field, lower_garment, waistband
from imgtransfer.garments.refit import refitted
from imgtransfer.garments.upper import upper_field, upper_garment
from imgtransfer.importers.checks.axes import Axes
from imgtransfer.importers.checks.template import load_template
from render import InputError, Option
from render.mesh.mesh import Mesh
from render.threads import one_blas_thread

OPENINGS = {
    "tshirt": ("neck", "left sleeve", "right sleeve", "hem"),
    "dress": ("neck", "left sleeve", "right sleeve", "hem"),
    "trousers": ("waist", "left hem", "right hem"),
    "skirt": ("waist", "hem"),
}
CLEARANCE = 0.002  # metres that every vertex must at least start from the body
_NONE = np.zeros(0, np.int64)


@dataclass(frozen=True, eq=False)
class Garment:
    """A garment as it is put on the resting body.

    Args:
        name: what data sets call it.
        mesh: where it starts, in the body's rest frame, metres, outside the body.
        openings: the vertices around each opening, by name.
        pinned: (H,) int64, vertices of a waistband, which stay where they are on the skin; without them trousers and
            skirts would slide down, as cloth without a belt does.
    """

    name: str
    mesh: Mesh
    openings: dict[str, np.ndarray]
    pinned: np.ndarray


@one_blas_thread()
def make_garment(
    body: SkinnedBody, config: GarmentConfig | None = None, *, like: SkinnedBody | None = None
) -> Garment:
    """The garment that `config` describes, on the body at rest; the same every time.

    Args:
        body: in an A- or T-pose, its arms off the trunk.
        config: None is a T-shirt.
        like: another shape of the same body: the garment is made for it and refitted to `body`, so that faces and
            vertices correspond. None makes the garment for `body` alone, with the evenest triangles.

    Raises:
        InputError: sizes that leave no clean surface with the openings that belong to the garment, or a template
            that cannot be read or starts inside the body.
    """
    config = config or TShirtConfig()
    if isinstance(config, TemplateConfig):
        return template_garment(resting(body), config)[0]
    maker = Figure.of(body if like is None else like)
    mesh = _surface(maker, config)
    _check(mesh, maker, config)
    if like is not None:
        return refitted_garment(mesh, maker, body, config)
    return _with_openings(mesh, _named(mesh, OPENINGS[config.kind]), config)


def refitted_garment(mesh: Mesh, maker: Figure, body: SkinnedBody, config: MadeConfig) -> Garment:
    """A garment that was made for one shape of a body, on another shape of it, with the same faces.

    Args:
        mesh: the garment as `make_garment` puts it on `maker`.
        maker: the figure that it was made for.
        body: the other shape.
        config: of the garment.

    Raises:
        InputError: a body with other faces, or sizes that leave no clean surface on it.
    """
    if not np.array_equal(maker.faces, body.faces):
        raise InputError(f"{config.kind}: only shapes of one body can share a garment; their faces differ")
    figure, openings = Figure.of(body), _named(mesh, OPENINGS[config.kind])
    borders = [(loop, _height(name, figure, config)) for name, loop in openings.items()]
    moved = refitted(mesh, maker, figure, _field(figure, config), borders)
    _check(moved, figure, config)
    return _with_openings(moved, openings, config)


def _with_openings(mesh: Mesh, openings: dict[str, np.ndarray], config: MadeConfig) -> Garment:
    return Garment(config.kind, mesh, openings, np.sort(openings.get("waist", _NONE)))


def resting(body: SkinnedBody) -> Mesh:
    """A body at rest, as messages about a template call it."""
    return Mesh(body.rest, body.faces, "the body")


def _height(opening: str, figure: Figure, config: MadeConfig) -> float | None:
    """Where an opening is cut horizontally, metres; None for necks and sleeves."""
    if opening.endswith("hem"):
        return figure.leg_height(config.length)
    if isinstance(config, SkirtConfig | TrousersConfig) and opening == "waist":
        return waistband(figure, config)
    return None


def _surface(figure: Figure, config: MadeConfig) -> Mesh:
    if isinstance(config, TShirtConfig | DressConfig):
        return upper_garment(figure, config)
    return lower_garment(figure, config)


def _field(figure: Figure, config: MadeConfig) -> Field:
    if isinstance(config, TShirtConfig | DressConfig):
        return upper_field(figure, config)
    return lower_field(figure, config)


def template_garment(
    body: Mesh, config: TemplateConfig, *, body_axes: Axes | None = None
) -> tuple[Garment, list[str]]:
    """The user's mesh, in our axes and units, welded if asked for, checked against the body that shall wear it.

    Args:
        body: at rest; its `source` is what messages call it.
        body_axes: how the body's file lay, where it came from one.

    Returns:
        The garment; and what is odd about it but no obstacle, one text each.

    Raises:
        InputError: no such file, no usable mesh, or a fault that the import of meshes would stop at, such as other
            units or axes than the body's, or a start deep inside the body.
    """
    mesh, notes = load_template(
        config.path,
        body,
        axes=config.axes,
        body_axes=body_axes,
        chosen=config.object,
        welding=config.weld,
        anyway=config.anyway,
    )
    loops = {f"opening {number}": loop for number, loop in enumerate(border_loops(mesh.faces), 1)}
    pinned = _NONE
    if config.pinned:
        if not loops:
            raise InputError(
                f"{config.path}: the mesh has no opening that could be a waistband; leave out {Option('pinned')}"
            )
        pinned = np.sort(max(loops.values(), key=lambda loop: mesh.vertices[loop, 1].mean()))
    return Garment(config.title, mesh, loops, pinned), notes


def _check(mesh: Mesh, figure: Figure, config: MadeConfig) -> None:
    """Raise InputError unless the surface is what a garment of its kind must be."""
    wanted = OPENINGS[config.kind]
    quality = mesh_quality(mesh)
    result = None
    if quality.non_manifold or quality.handles or quality.openings != len(wanted):
        result = f"a surface with {quality.openings} openings and {quality.handles} handles"
    elif quality.intersecting or quality.duplicates:
        result = (
            f"{max(quality.intersecting, quality.duplicates)} faces that pass through others or touch them"
        )
    elif (clearance := _distance(mesh.vertices, figure.vertices, figure.faces).min()) < CLEARANCE:
        result = f"cloth that starts {1000 * clearance:.1f} mm from the body ({1000 * CLEARANCE:.0f} mm are needed)"
    if result:
        sizes = config.model_dump(exclude={"kind", "name"}, exclude_defaults=True) or "by default"
        raise InputError(
            f"{config.kind}: the sizes {sizes} give {result}, where one piece with {', '.join(wanted)} is wanted on "
            "this body; use a smaller edge_length, less ease or flare, or lengths nearer to the defaults"
        )


def _distance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    sdf = BodySdf(faces, len(vertices))
    sdf.update(vertices.astype(np.float32))
    return sdf.distance(torch.from_numpy(points.astype(np.float32))).numpy()


def _named(mesh: Mesh, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The border loops by name: the first at the top, a left one farthest along +x, and so on."""
    loops = border_loops(mesh.faces)
    centres = {number: mesh.vertices[loop].mean(axis=0) for number, loop in enumerate(loops)}
    named = {}
    for name in names:
        axis, sign = {"left": (0, 1), "righ": (0, -1), "hem": (1, -1)}.get(name[:4], (1, 1))
        number = max(centres, key=lambda n: sign * centres[n][axis])
        del centres[number]
        named[name] = loops[number]
    return named
