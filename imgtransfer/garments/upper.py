"""Garments that hang from the shoulders: T-shirt and dress."""

from __future__ import annotations

import numpy as np

from imgtransfer.garments.config import DressConfig, TShirtConfig
from imgtransfer.garments.field import Field, body_distance, hanging, hull_distance
from imgtransfer.garments.figure import Figure
from imgtransfer.garments.finish import Cut, cut_surface
from render.mesh.mesh import Mesh

_CELL = 0.01  # metres, of the grid
_PAST_SLEEVE = 0.08  # fraction of the arm that is kept behind the sleeve's end
_NECK_AXIS = np.array([0.0, 0.93, 0.37])  # the neckline is lower in front
_CHEST = 0.1  # metres below the shoulder joints, where a T-shirt begins to flare
_ON_SHOULDERS, _NEAREST = 0.45, 0.35  # fractions of the ease: on top of the shoulders, and anywhere at least
_BRIDGE = 0.10  # metres above the crotch, from where a T-shirt hangs straight instead of following the legs


def upper_garment(figure: Figure, config: TShirtConfig | DressConfig) -> Mesh:
    """The garment's surface with neck, sleeves and hem cut; not checked yet."""
    return cut_surface(upper_field(figure, config), _cuts(figure, config), config.target_edge, config.kind)


def upper_field(figure: Figure, config: TShirtConfig | DressConfig) -> Field:
    """The field whose zero level is the garment, before it is cut."""
    body = figure.shortened_arms(config.sleeve + _PAST_SLEEVE)
    hem = figure.leg_height(config.length)
    top = figure.waist if isinstance(config, DressConfig) else figure.crotch + _BRIDGE
    flared_from = (
        figure.waist if isinstance(config, DressConfig) else figure.joint("left_shoulder")[1] - _CHEST
    )
    widest = config.ease + config.flare * max(flared_from - hem, 0.0) + 0.05
    low, high = body.min(axis=0) - widest, body.max(axis=0) + widest
    low[1], high[1] = hem - 0.03, figure.joint("head")[1]
    distance = body_distance(body, figure.faces, low, high, cell=_CELL, band=widest)
    heights = distance.heights
    ease = config.ease * _shoulder_share(figure, heights) + config.flare * np.clip(
        flared_from - heights, 0, None
    )
    worn = distance.smoothed(config.smoothing).values - ease[None, :, None]
    if hem < top:
        supports = hanging(figure.supports(np.maximum(heights, figure.leg_height(0.92))), heights, top)
        tube = hull_distance(distance, figure.axis, supports) - ease[None, :, None]
        worn = np.where((heights <= top)[None, :, None], np.minimum(worn, tube), worn)
        worn = distance.with_values(worn).smoothed(_CELL).values
    # Smoothing may cut through the body where it bulges.
    return distance.with_values(np.minimum(worn, distance.values - _NEAREST * config.ease))


def _shoulder_share(figure: Figure, heights: np.ndarray) -> np.ndarray:
    """(Y,) fraction of the ease by height: less on top of the shoulders, where the garment's weight lies."""
    fraction = np.clip((heights - figure.joint("left_shoulder")[1] + 0.02) / 0.08, 0, 1)
    return 1 - (1 - _ON_SHOULDERS) * fraction * fraction * (3 - 2 * fraction)


def _cuts(figure: Figure, config: TShirtConfig | DressConfig) -> list[Cut]:
    """Fields that are positive where cloth is removed: neck, sleeves, hem."""
    hem = figure.leg_height(config.length)

    def sleeve_cut(side: str) -> Cut:
        end, along = figure.sleeve_end(side, config.sleeve)
        # The plane across the arm also meets the trunk: only what is nearer to the arm is cut.
        return lambda points: np.minimum((points - end) @ along, figure.nearer_to_arm(points, side))

    return [
        _neck_cut(figure, config),
        sleeve_cut("left"),
        sleeve_cut("right"),
        lambda points: hem - points[:, 1],
    ]


def _neck_cut(figure: Figure, config: TShirtConfig | DressConfig) -> Cut:
    """Positive within a tilted tube around the neck, wider in front: the garment leaves it along a round neckline."""
    centre, radius = figure.neck
    forward = np.array([0.0, -_NECK_AXIS[2], _NECK_AXIS[1]])
    side = 1.33 * radius + 0.65 * config.ease + 0.2 * config.neck  # wider ones slide off a shoulder
    front = 1.3 * radius + config.ease + 1.5 * config.neck
    back = 1.3 * radius + 0.65 * config.ease + 0.2 * config.neck

    def cut(points: np.ndarray) -> np.ndarray:
        offset = points - centre
        ahead = offset @ forward
        within = side * (1 - np.hypot(offset[:, 0] / side, ahead / np.where(ahead > 0, front, back)))
        return np.minimum(within, offset @ _NECK_AXIS + 0.04 + config.neck)  # the trunk's sides stay

    return cut
