"""A garment imaged by its views, or laid out flat with its body (`maps.views: uv`; the paper's table 7)."""

from __future__ import annotations

from imgtransfer.network.config import MapsConfig
from render import InputError, Mesh, TemplateImager
from render.maps.layout import flat_layout


def layouts_of(maps: MapsConfig, template: Mesh, body: Mesh | None) -> tuple[Mesh, Mesh] | None:
    """Garment and rest body laid out flat by xatlas, with `maps.views: uv`; None where views are imaged.

    Raises:
        InputError: no xatlas, or no body.
    """
    if not maps.laid_out:
        return None
    if body is None:
        raise InputError(
            f"{template.source}: no body to lay out; maps.views: uv needs the garment's body at rest"
        )
    return flat_layout(template), flat_layout(body)


def garment_imager(maps: MapsConfig, template: Mesh, layouts: tuple[Mesh, Mesh] | None) -> TemplateImager:
    """The imager of a garment, by its views or by the first of `layouts`."""
    if layouts is not None:
        return TemplateImager.build(template, layout=layouts[0], size=maps.size)
    return TemplateImager.build(template, views=maps.views, size=maps.size, layers=maps.layers)
