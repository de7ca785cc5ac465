"""Garments that hang from the waist: skirt and trousers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from imgtransfer.garments.config import SkirtConfig, TrousersConfig
from imgtransfer.garments.field import Field, body_distance, hanging, hull_distance
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.finish import Cut, cut_surface
from render.mesh.mesh import Mesh

_SKIRT_CELL, _TROUSERS_CELL = 0.01, 0.007  # metres, of the grid
_BAND = 0.10  # metres below the waistband, where the full ease is reached
_ARM = 0.12  # fraction of the arms that is left to the body
_LEG_GAP = 0.02  # metres between the trouser legs' inner sides, of which smoothing leaves half


def lower_garment(figure: Figure, config: SkirtConfig | TrousersConfig) -> Mesh:
    """The garment's surface with waistband and hems cut; not checked yet."""
    top, hem = waistband(figure, config), figure.leg_height(config.length)
    cuts: list[Cut] = [lambda points: points[:, 1] - top, lambda points: hem - points[:, 1]]
    return cut_surface(lower_field(figure, config), cuts, config.target_edge, config.kind)


def lower_field(figure: Figure, config: SkirtConfig | TrousersConfig) -> Field:
    """The field whose zero level is the garment, before it is cut."""
    return _skirt(figure, config) if isinstance(config, SkirtConfig) else _trousers(figure, config)


def waistband(figure: Figure, config: SkirtConfig | TrousersConfig) -> float:
    """Height of the waistband's upper edge, metres."""
    return figure.waist + config.waist


def _grid(figure: Figure, config: SkirtConfig | TrousersConfig, widest: float, cell: float) -> Field:
    """Distance to the body without arms, from below the hem to above the waistband."""
    body = figure.shortened_arms(_ARM)
    bottom, top = figure.leg_height(config.length) - 0.03, waistband(figure, config) + 0.04
    near = body[(body[:, 1] > bottom - 0.05) & (body[:, 1] < top + 0.05)]
    low, high = near.min(axis=0) - widest, near.max(axis=0) + widest
    low[1], high[1] = bottom, top
    return body_distance(body, figure.faces, low, high, cell=cell, band=widest)


def _band_ease(config: SkirtConfig | TrousersConfig, below: np.ndarray) -> np.ndarray:
    """(Y,) distance to the body by the depth below the waistband, metres: from snug to the full ease."""
    fraction = np.clip(below / _BAND, 0, 1)
    return config.waist_ease + (config.ease - config.waist_ease) * fraction * fraction * (3 - 2 * fraction)


def _skirt(figure: Figure, config: SkirtConfig) -> Field:
    top = waistband(figure, config)
    widest = config.ease + config.flare * (top - figure.leg_height(config.length)) + 0.05
    distance = _grid(figure, config, widest, _SKIRT_CELL)
    below = top - distance.heights
    ease = _band_ease(config, below) + config.flare * np.clip(below - _BAND / 2, 0, None)
    supports = figure.supports(np.maximum(distance.heights, figure.leg_height(0.92)))
    tube = hull_distance(distance, figure.axis, hanging(supports, distance.heights, top))
    worn = distance.with_values(tube - ease[None, :, None]).smoothed(config.smoothing / 2).values
    return distance.with_values(np.minimum(worn, distance.values - config.waist_ease / 2))


def _trousers(figure: Figure, config: TrousersConfig) -> Field:
    hips = figure.leg_height(0.0)
    widest = config.ease + config.flare * (hips - figure.leg_height(config.length)) + 0.04
    distance = _grid(figure, config, widest, _TROUSERS_CELL)
    heights = distance.heights
    ease = _band_ease(config, waistband(figure, config) - heights)
    ease = ease + config.flare * np.clip(hips - heights, 0, None)
    worn = distance.smoothed(config.smoothing).values - ease[None, :, None]
    # Below the crotch the legs are kept apart by a slit around the surface midway between them.
    slit = np.minimum(
        _LEG_GAP / 2 - np.abs(_leg_difference(figure, distance.points)) / 2,
        (figure.crotch - config.ease - heights)[None, :, None],
    )
    worn = distance.with_values(np.maximum(worn, slit)).smoothed(_TROUSERS_CELL).values
    return distance.with_values(np.minimum(worn, distance.values - config.waist_ease / 2))


def _leg_difference(figure: Figure, points: np.ndarray) -> np.ndarray:
    """(X, Y, Z) distance to the left leg's bones less that to the right's, metres."""
    to_legs = []
    for side in ("left", "right"):
        chain = [figure.joint(f"{side}_{name}") for name in ("hip", "knee", "ankle")]
        near = [_to_segment(points, a, b) for a, b in pairwise(chain)]
        to_legs.append(np.minimum(*near))
    return to_legs[0] - to_legs[1]


def _to_segment(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    fraction = np.clip((points - start) @ (end - start) / ((end - start) ** 2).sum(), 0, 1)
    return np.linalg.norm(points - start - fraction[..., None] * (end - start), axis=-1)
