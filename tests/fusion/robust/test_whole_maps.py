"""Maps that are larger than the garment, and views that do not agree."""

import pytest
import torch

from fusion.robust.pixel_links import PixelLinks
from fusion.robust.whole_maps import WholeMaps
from render import TemplateImager
from tests.helpers.fusion_examples import true_maps, tube, wrinkled
from tests.helpers.sheets import own_maps, sheet_imager

CPU = torch.device("cpu")
# The tube's flanks are seen by neither front nor back; its front and its left side overlap.
TUBE = TemplateImager.build(tube(), views=("front", "left"), size=(48, 40), backend="numpy")
TRUE, _ = true_maps(TUBE, wrinkled(tube(), 3))


def faults(maps, known=None, imager=TUBE):
    links = PixelLinks(imager, imager.mesh, CPU)
    return WholeMaps(imager, links, imager.mesh, CPU).faults(maps, known)


def test_true_maps_have_none():
    assert faults(TRUE) == [[], [], []]


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_a_box_of_another_size_is_said(scale):
    maps = TRUE.clone()
    maps[1] *= scale
    first, (fault,), last = faults(maps)
    assert (first, last) == ([], [])
    assert (fault.kind, fault.view, fault.rows) == ("scale", "", None)
    assert fault.scale == pytest.approx(scale, rel=0.02)
    assert f"{fault.scale:.2f} times as large as the garment" in str(fault)


def test_noise_in_every_pixel_makes_no_map_larger():
    """It makes steps between neighbours longer, here by half; spans of three edges by less than a twentieth."""
    footprint = PixelLinks(TUBE, TUBE.mesh, CPU).footprint
    noise = torch.randn(TRUE.shape, generator=torch.Generator().manual_seed(0))
    assert faults(TRUE + 0.6 * footprint * noise) == [[], [], []]


def test_views_that_put_what_both_see_at_different_places_are_named():
    maps = TRUE.clone()
    maps[2, 1] += torch.tensor([0.0, 0.2, 0.0])
    first, second, (fault,) = faults(maps)
    assert (first, second) == ([], [])
    assert (fault.kind, fault.view) == ("views", "front and left")
    assert fault.offset_m == pytest.approx(0.2, rel=0.2)
    assert str(fault).startswith("front and left: ")


def test_pixels_without_a_confidence_do_not_count():
    maps = TRUE.clone()
    maps[:, 1] += 1
    known = torch.ones(maps.shape[:-1], dtype=torch.bool)
    known[:, 1] = False
    assert faults(maps, known) == [[], [], []]
    assert faults(maps, torch.zeros_like(known)) == [[], [], []]


def test_a_single_view_has_nothing_to_disagree_with():
    imager = sheet_imager()
    assert faults(own_maps(imager), imager=imager) == [[]]


def test_a_template_of_one_pixel_tells_nothing():
    imager = sheet_imager(size=(1, 1))
    assert faults(own_maps(imager), imager=imager) == [[]]
