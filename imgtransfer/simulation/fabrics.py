"""Three fabrics in physical units.

Cloth is measured by its weight, its bending length c (the cantilever test of ASTM D1388, from which Peirce's relation
gives the flexural rigidity D = density · g · c³) and its friction. The values are typical of their kind, none is of one
particular cloth:

- cotton: a T-shirt's single jersey, 180 g/m², c = 15 mm. On dry skin it slides at 0.25 (forearm) to 0.79 (chest; Temel,
  Johnson and Lloyd, Tribology Letters 70, 2022).
- silk: a charmeuse of 16 momme (4.34 g/m² each), c = 14 mm; smoother than cotton.
- denim: 11 ounces per square yard (33.9 g/m² each), c = 27 mm; stiff, thick and rough.

Stretch is lower than what tensile tests of woven cloth show (several kN/m): at rest hardly anything pulls at a garment,
and stiffer membranes need more iterations to look the same. What is kept is the order: denim resists more than
silk, and silk (woven) more than jersey (knitted).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Fabric = Literal["cotton", "silk", "denim"]
GRAVITY = 9.81  # m/s²


def rigidity(density: float, bending_length: float) -> float:
    """Flexural rigidity in N·m by Peirce's relation from kg/m² and the bending length in metres."""
    return density * GRAVITY * bending_length**3


# By the names of `ClothConfig`, in its units.
FABRICS: Mapping[str, Mapping[str, float]] = {
    "cotton": {
        "density": 0.18,
        "stretch": 1000.0,
        "bending": rigidity(0.18, 0.015),
        "stretch_damping": 1e-5,
        "bending_damping": 0.02,
        "friction": 0.35,
        "thickness": 0.004,
    },
    "silk": {
        "density": 0.0694,
        "stretch": 1200.0,
        "bending": rigidity(0.0694, 0.014),
        "stretch_damping": 1e-5,
        "bending_damping": 0.02,
        "friction": 0.2,
        "thickness": 0.004,
    },
    "denim": {
        "density": 0.373,
        "stretch": 2500.0,
        "bending": rigidity(0.373, 0.027),
        "stretch_damping": 1e-5,
        "bending_damping": 0.02,
        "friction": 0.45,
        "thickness": 0.005,
    },
}
