"""Anny's phenotype parameters, and how a shape mixes the corners of their lattice.

Between the values at which Anny has shapes ("anchors") every parameter interpolates linearly, and Anny's blend shapes
are products of these weights. Anny's rest shape is therefore exactly multilinear over the lattice of all anchors: the
shapes at its corners say everything.
"""

from __future__ import annotations

import itertools

import numpy as np
from pydantic import Field

from imgtransfer.config.schema import Ratio, Section

# Parameter -> its anchors. Ages below 1/3 (babies) are left out.
ANCHORS: dict[str, tuple[float, ...]] = {
    "gender": (0.0, 1.0),
    "age": (1 / 3, 2 / 3, 1.0),
    "muscle": (0.0, 0.5, 1.0),
    "weight": (0.0, 0.5, 1.0),
    "height": (0.0, 1.0),
    "proportions": (0.0, 1.0),
}
# (216, 6): the parameters at every corner, the last parameter changing fastest.
CORNERS = np.array(list(itertools.product(*ANCHORS.values())))


class AnnyShape(Section):
    """A body's shape by Anny's phenotype parameters, each a ratio between two extremes."""

    gender: Ratio = Field(0.5, ge=0, le=1, description="0 is male, 1 female.")
    age: Ratio = Field(0.5, ge=0.5, le=1, description="0.5 is a youth, 2/3 a young adult, 1 old.")
    muscle: Ratio = Field(0.5, ge=0, le=1, description="From the least muscles to the most.")
    weight: Ratio = Field(0.5, ge=0, le=1, description="From the thinnest to the heaviest.")
    height: Ratio = Field(0.5, ge=0, le=1, description="Of a young man, 0 is 1.36 m and 1 is 2.45 m.")
    proportions: Ratio = Field(0.5, ge=0, le=1, description="0 is idealised, 1 uncommon.")


def random_shape(seed: int) -> AnnyShape:
    """An adult drawn by seed: statures of about 1.45 to 1.90 m, without extremes of weight and muscle."""
    rng = np.random.default_rng([seed, 0xA22])
    return AnnyShape(
        gender=round(float(rng.uniform(0, 1)), 3),
        age=round(float(rng.uniform(0.62, 0.95)), 3),
        muscle=round(float(rng.triangular(0.2, 0.5, 0.9)), 3),
        weight=round(float(rng.triangular(0.15, 0.5, 0.9)), 3),
        height=round(float(rng.triangular(0.15, 0.35, 0.5)), 3),
        proportions=round(float(rng.uniform(0.0, 0.8)), 3),
    )


def corner_weights(shape: AnnyShape) -> np.ndarray:
    """(216,) float64, weight of every lattice corner in the shape; sums to 1."""
    weights = np.ones(1)
    for name, anchors in ANCHORS.items():
        hats = [np.interp(getattr(shape, name), anchors, row) for row in np.eye(len(anchors))]
        weights = np.multiply.outer(weights, hats).ravel()
    return weights
