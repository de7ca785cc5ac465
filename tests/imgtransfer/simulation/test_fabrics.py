"""Fabrics in their configuration, and strips of them that hang over an edge."""

import numpy as np
import pytest

from imgtransfer.simulation.cloth.model import ClothOnBody
from imgtransfer.simulation.config import ClothConfig, SolverConfig
from imgtransfer.simulation.fabrics import FABRICS, GRAVITY, rigidity
from render.mesh.mesh import Mesh

FAR = np.array([[0, -9, 0], [0.1, -9, 0], [0, -9, 0.1], [0, -9.1, 0]], np.float32)  # a body out of the way
FAR_FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
EDGE = 0.008
STEP = 1 / 2000  # s


# Nothing pulls at a cantilever, and stretch that is no stiffer than bending lets the descent converge.
SOFT = {"stretch": 20.0, "stretch_damping": 0.0, "bending_damping": 0.005}


def strip(length, width=0.02):
    """Rows of near-equilateral triangles along +x, level; the first two columns are to be pinned."""
    rows = round(width / (EDGE * np.sqrt(3) / 2))
    columns = round(length / EDGE) + 2
    points = [
        (EDGE * (column - 1 + (row % 2) / 2), 0, row * EDGE * np.sqrt(3) / 2)
        for row in range(rows + 1)
        for column in range(columns)
    ]
    faces = []
    for row in range(rows):
        for column in range(columns - 1):
            a, b = row * columns + column, row * columns + column + 1
            c, d = a + columns, b + columns
            faces += [(a, c, b), (b, c, d)] if row % 2 == 0 else [(a, c, d), (a, d, b)]
    return Mesh(np.array(points, np.float64), np.array(faces))


def droop(length, seconds=0.4, **material):
    """Metres by which the free end of a strip hangs lower than its clamped one, at rest."""
    mesh = strip(length)
    pinned = np.flatnonzero(mesh.vertices[:, 0] <= 1e-9)
    config = ClothConfig.model_validate({**SOFT, **material})
    cloth = ClothOnBody(mesh, FAR, FAR_FACES, config, SolverConfig(iterations=40), pinned=pinned)
    for _ in range(round(seconds / STEP)):
        cloth.step(FAR, STEP)
        cloth.place(cloth.vertices, 0.9925 * cloth.velocities, FAR)
    assert np.abs(cloth.velocities).max() < 0.1
    return -cloth.vertices[:, 1].min()


def test_a_fabric_fills_in_what_is_not_given():
    assert ClothConfig() == ClothConfig(fabric="cotton")
    silk = ClothConfig.model_validate({"fabric": "silk", "friction": 0.5})
    assert (silk.friction, silk.density) == (0.5, FABRICS["silk"]["density"])
    with pytest.raises(ValueError, match="cotton"):
        ClothConfig.model_validate({"fabric": "wool"})


def test_the_fabrics_order_in_weight_stiffness_and_grip():
    cotton, silk, denim = (ClothConfig.model_validate({"fabric": name}) for name in FABRICS)
    for name in ("density", "bending", "friction"):
        assert getattr(silk, name) < getattr(cotton, name) < getattr(denim, name)
    assert rigidity(0.1, 0.02) == pytest.approx(0.1 * 9.81 * 8e-6)


def test_a_short_strip_droops_as_a_beam_does():
    # Small deflections of a cantilever under its own weight: w L⁴ / (8 D). The first hinges lie half an edge inside.
    length, bending = strip(0.04).vertices[:, 0].max() + EDGE / 2, 3e-4
    wanted = FABRICS["denim"]["density"] * GRAVITY * length**4 / (8 * bending)
    assert droop(0.04, fabric="denim", bending=bending) == pytest.approx(wanted, rel=0.15)


def test_denim_droops_least():
    cotton, silk, denim = (droop(0.04, fabric=name) for name in FABRICS)
    assert denim < 0.75 * min(cotton, silk)
    assert max(cotton, silk) < 0.05
