"""Parts of a map that hold together but lie elsewhere: found, brought back, and described."""

import numpy as np
import pytest
import torch

from fusion.robust.automatic_confidence import AutomaticConfidence
from render import Mesh, TemplateImager
from tests.helpers.example_meshes import two_quads
from tests.helpers.sheets import own_maps, sheet_imager

IMAGER = sheet_imager(size=(40, 44))
MASK = IMAGER.mask[0]
ROWS, COLUMNS = ((int(places.min()), int(places.max())) for places in MASK.nonzero(as_tuple=True))
LEFT = np.s_[:, :, :, COLUMNS[1] - 9 :]  # of the sheet's 10 last columns, at its wearer's left


def judge(maps, confidence=None, imager=IMAGER):
    return AutomaticConfidence(imager, imager.mesh, torch.device("cpu")).judge(maps, confidence)


@pytest.mark.parametrize("offset", [(0.1, 0.0, 0.0), (0.0, 0.0, -0.1), (0.05, -0.2, 0.1)])
def test_a_region_that_lies_elsewhere_is_brought_back_by_as_much(offset):
    maps = own_maps(IMAGER)
    maps[LEFT] += torch.tensor(offset)
    judged = judge(maps)
    (fault,) = judged.findings.faults[0]
    assert (fault.kind, fault.view) == ("offset", "front")
    assert (fault.rows, fault.columns) == (ROWS, (COLUMNS[1] - 9, COLUMNS[1]))
    assert fault.pixels == 10 * (ROWS[1] - ROWS[0] + 1)
    assert fault.offset_m == pytest.approx(np.linalg.norm(offset), rel=1e-3)
    assert fault.scale == pytest.approx(1, rel=1e-3)
    assert fault.place == "wearer's left, middle"
    np.testing.assert_allclose(IMAGER.mesh.vertices[fault.vertex], [0.15, 0, 0], atol=0.03)
    torch.testing.assert_close(
        judged.positions[:, IMAGER.mask], own_maps(IMAGER)[:, IMAGER.mask], atol=1e-4, rtol=0
    )
    moved = torch.zeros_like(IMAGER.mask)
    moved[LEFT[1:]] = IMAGER.mask[LEFT[1:]]
    assert judged.confidence[0][moved].unique().tolist() == pytest.approx([0.1])
    assert (judged.confidence[0][~moved] == 1).all()
    assert judged.findings.left_out.tolist() == [0]


def test_a_region_that_is_turned_with_its_limb_is_brought_back_in_its_own_turn():
    """Folded forwards by 90° at its border and then moved: only the move is taken back."""
    folded = own_maps(IMAGER)
    border = float(folded[0, 0, ROWS[0] + 3, COLUMNS[1] - 9, 0])
    depth = (folded[..., 0] - border).clamp(min=0)
    folded[..., 2] += depth
    folded[..., 0] -= depth
    maps = folded.clone()
    maps[LEFT] += torch.tensor([0.0, 0.1, 0.0])
    judged = judge(maps)
    footprint = 0.4 / (COLUMNS[1] - COLUMNS[0])
    torch.testing.assert_close(
        judged.positions[:, IMAGER.mask], folded[:, IMAGER.mask], atol=1.5 * footprint, rtol=0
    )


@pytest.mark.parametrize("scale", [0.4, 1.8])
def test_a_region_of_another_size_is_scaled_back(scale):
    maps = own_maps(IMAGER)
    maps[LEFT] = maps[LEFT] * scale + torch.tensor([0.0, 0.0, 0.3])
    judged = judge(maps)
    (fault,) = judged.findings.faults[0]
    assert fault.kind == "offset"
    assert fault.scale == pytest.approx(scale, rel=1e-2)
    assert f"{scale:.2f} times as large as the garment" in str(fault)
    torch.testing.assert_close(
        judged.positions[:, IMAGER.mask], own_maps(IMAGER)[:, IMAGER.mask], atol=5e-3, rtol=0
    )


def test_a_region_whose_pixels_do_not_fit_each_other_is_left_out_and_named():
    maps = own_maps(IMAGER)
    maps[LEFT] *= 5
    judged = judge(maps)
    (fault,) = judged.findings.faults[0]
    assert (fault.kind, fault.view, fault.rows) == ("unfit", "front", ROWS)
    assert abs(fault.columns[0] - (COLUMNS[1] - 9)) <= 1
    assert fault.scale == pytest.approx(5, rel=1e-2)
    assert judged.findings.left_out[0] == pytest.approx(10 / (COLUMNS[1] - COLUMNS[0] + 1), rel=0.15)


def test_of_a_map_torn_in_two_the_larger_half_stays():
    maps = own_maps(IMAGER)
    middle = (ROWS[0] + ROWS[1]) // 2 - 1
    maps[:, :, :middle, :, 1] += 0.2
    judged = judge(maps)
    (fault,) = judged.findings.faults[0]
    assert fault.rows == (ROWS[0], middle - 1)
    torch.testing.assert_close(
        judged.positions[:, IMAGER.mask], own_maps(IMAGER)[:, IMAGER.mask], atol=1e-4, rtol=0
    )


def test_a_region_that_borders_only_on_another_follows_it():
    """Two bands of columns, each elsewhere: the outer one borders on the inner one alone."""
    maps = own_maps(IMAGER)
    maps[:, :, :, COLUMNS[1] - 9 : COLUMNS[1] - 4, 2] += 0.1
    maps[:, :, :, COLUMNS[1] - 4 :, 1] += 0.3
    judged = judge(maps)
    assert len(judged.findings.faults[0]) == 2
    torch.testing.assert_close(
        judged.positions[:, IMAGER.mask], own_maps(IMAGER)[:, IMAGER.mask], atol=1e-4, rtol=0
    )


def test_a_scrap_too_small_to_be_placed_is_left_out():
    maps = own_maps(IMAGER)
    maps[:, 0, ROWS[0] : ROWS[0] + 2, COLUMNS[0] + 3 : COLUMNS[0] + 7, 2] += 0.2
    judged = judge(maps)
    assert judged.findings.faults == [[]]
    out = (judged.confidence[0, 0] == 0).nonzero()
    assert len(out) == 8
    assert out.min(0).values.tolist() == [ROWS[0], COLUMNS[0] + 3]


def test_a_slit_that_does_not_cut_a_part_off_is_no_region():
    maps = own_maps(IMAGER)
    opened = (torch.arange(40)[:, None] - ROWS[0] < 12) * (torch.arange(44) > (COLUMNS[0] + COLUMNS[1]) // 2)
    maps[0, 0, ..., 2] += opened * 0.01 * (12 - (torch.arange(40)[:, None] - ROWS[0])).clamp(min=0)
    judged = judge(maps)
    assert judged.findings.faults == [[]]
    assert judged.findings.left_out[0] < 0.01


def test_pieces_of_cloth_that_are_not_sewn_together_may_lie_anywhere():
    imager = TemplateImager.build(two_quads(gap=0.01), views=("back",), size=(48, 48), backend="numpy")
    maps = own_maps(imager)
    faces = torch.from_numpy(imager.raster.face_id)
    maps += ((faces >= 2)[None, ..., None]) * torch.tensor([0.0, 0.0, -0.5])
    judged = judge(maps, imager=imager)
    assert judged.positions is maps
    assert judged.confidence is None


def test_a_rest_shape_of_another_size_is_what_counts():
    rest = Mesh(1.5 * IMAGER.mesh.vertices, IMAGER.mesh.faces)
    judgement = AutomaticConfidence(IMAGER, rest, torch.device("cpu"))
    maps = 1.5 * own_maps(IMAGER)
    assert judgement.judge(maps, None).findings.faults == [[]]
    maps[LEFT] += torch.tensor([0.0, 0.0, 0.1])
    (fault,) = judgement.judge(maps, None).findings.faults[0]
    assert fault.scale == pytest.approx(1, rel=1e-3)
    assert fault.offset_m == pytest.approx(0.1, rel=1e-3)
