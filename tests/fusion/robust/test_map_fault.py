"""Faults in words, and over a clip."""

from dataclasses import replace

import numpy as np
import pytest

from fusion.robust.map_fault import FaultLog, MapFault, place_on
from tests.helpers.example_meshes import two_triangles

SLEEVE = MapFault(
    "offset",
    "front",
    412,
    offset_m=0.102,
    rows=(40, 71),
    columns=(3, 25),
    vertex=7,
    place="wearer's left, top",
)


def test_a_fault_is_said_with_its_place_in_millimetres():
    assert str(SLEEVE) == (
        "front: 412 pixels at the wearer's left, top (rows 40-71, columns 3-25, about vertex 7) lay 102 mm off their "
        "surroundings: brought back"
    )
    assert (
        "(rows 40-71, columns 3-25, about vertex 7), 1.50 times as large as the garment, lay 102 mm off"
        in str(replace(SLEEVE, scale=1.5))
    )
    assert str(replace(SLEEVE, kind="unfit", scale=3)).endswith(
        " fit neither each other nor their surroundings, 3.00 times as large as the garment: left out"
    )


@pytest.mark.parametrize(
    ("point", "wanted"),
    [
        ((0.4, 0.4, 0), (2, "wearer's left, top")),
        ((-0.4, -0.4, 0), (0, "wearer's right, bottom")),
        ((-0.1, 0.1, 0), (3, "centre, middle")),
        ((-0.5, 0.5, 0), (3, "wearer's right, top")),
    ],
)
def test_places_are_thirds_of_the_template(point, wanted):
    assert place_on(two_triangles(), np.array([point], float)) == wanted


def test_a_fault_that_goes_on_is_one_whatever_the_batches():
    log = FaultLog()
    log.add(3, [SLEEVE])
    log.add(4, [replace(SLEEVE, pixels=500, rows=(60, 80)), replace(SLEEVE, view="back")])
    log.add(6, [replace(SLEEVE, rows=(70, 90))])
    front, back = log.report()
    assert (front["frames"], front["n_frames"], front["worst_frame"]) == ([3, 6], 3, 4)
    assert (front["kind"], front["view"], front["pixels"], front["rows"]) == (
        "offset",
        "front",
        500,
        [60, 80],
    )
    assert front["offset_mm"] == pytest.approx(102)
    assert front["text"].startswith("3 frames of 3-6: front: 500 pixels at ")
    assert back["text"].startswith("frame 4: back: ")


def test_faults_of_another_kind_or_place_are_others():
    log = FaultLog()
    log.add(0, [SLEEVE, replace(SLEEVE, kind="unfit"), replace(SLEEVE, columns=(26, 30))])
    assert len(log.report()) == 3


def test_what_is_of_whole_maps_has_no_place():
    log = FaultLog()
    for frame in (0, 1):
        log.add(frame, [MapFault("scale", "", 1000, scale=1.1)])
    (entry,) = log.report()
    assert "rows" not in entry
    assert entry["text"] == (
        "frames 0-1: the maps are 1.10 times as large as the garment; is it their box, or the unit?"
    )
