"""Which pixels are left out, which regions are brought back, and that maps that hold together stay as they are."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fusion.robust.automatic_confidence import AutomaticConfidence
from render import Mesh
from tests.helpers.fusion_examples import imager_of, true_maps, tube, wrinkled
from tests.helpers.sheets import SIDE, own_maps, sheet, sheet_imager

CPU = torch.device("cpu")
IMAGER = sheet_imager()
MASK = IMAGER.mask[0]
ROWS, COLUMNS = ((int(places.min()), int(places.max())) for places in MASK.nonzero(as_tuple=True))


def judge(maps, confidence=None, imager=IMAGER):
    return AutomaticConfidence(imager, imager.mesh, CPU).judge(maps, confidence)


def left_out(judged, imager=IMAGER):
    """(T, S, H, W) bool, covered pixels without confidence."""
    return (judged.confidence == 0) & imager.mask


def scattered(maps, fraction, seed=0, sigma=0.2, imager=IMAGER):
    """Maps with normal noise of `sigma` metres on a fraction of the covered pixels, and which those are."""
    random = torch.Generator().manual_seed(seed)
    wrong = (torch.rand(maps.shape[:-1], generator=random) < fraction) & imager.mask
    return maps + sigma * torch.randn(maps.shape, generator=random) * wrong[..., None], wrong


@pytest.mark.parametrize(
    "place",
    [(ROWS[0] + 5, COLUMNS[0] + 6), (ROWS[0], COLUMNS[0] + 3), (ROWS[0], COLUMNS[0]), (ROWS[1], COLUMNS[1])],
    ids=["inside", "outline", "corner", "last"],
)
def test_one_pixel_elsewhere_is_left_out_and_no_other(place):
    maps = own_maps(IMAGER, frames=2)
    maps[1, 0, *place, 2] += 0.2
    judged = judge(maps)
    wanted = torch.zeros_like(maps[..., 0], dtype=torch.bool)
    wanted[1, 0, *place] = True
    assert torch.equal(left_out(judged), wanted)
    assert torch.equal(judged.positions, maps)
    np.testing.assert_allclose(judged.findings.left_out, [0, 1 / int(MASK.sum())])
    assert judged.findings.faults == [[], []]


def test_pixels_are_kept_as_a_plain_loop_keeps_them():
    """Twice: fits more than half of its neighbours; more than half of those that were kept the first time."""
    judgement = AutomaticConfidence(IMAGER, IMAGER.mesh, CPU)
    links = judgement._links
    maps, _ = scattered(own_maps(IMAGER), 0.3)
    points = maps[0][IMAGER.mask].numpy()
    counts, fits = links.fitting(points)
    neighbours = [{} for _ in points]
    for first, second, fit in zip(links.first, links.second, fits, strict=True):
        neighbours[first][second] = neighbours[second][first] = fit
    once = [2 * sum(near.values()) > len(near) for near in neighbours]
    wanted = []
    for near in neighbours:
        fitting = [fit for other, fit in near.items() if once[other]]
        wanted.append(2 * sum(fitting) > len(fitting))
    assert judgement._fitting_most(counts, fits).tolist() == wanted
    assert sum(once) < sum(wanted) < len(wanted)


def test_what_is_scattered_is_found_and_hardly_anything_else():
    for size in ((32, 32), (128, 128)):
        imager = sheet_imager(size=size)
        maps, wrong = scattered(own_maps(imager, frames=2), 0.1, imager=imager)
        out = left_out(judge(maps, imager=imager), imager)
        assert (out & wrong).sum() >= 0.99 * wrong.sum()
        assert (out & ~wrong).sum() <= 0.01 * wrong.sum() + 1


def test_a_garment_of_another_size_is_judged_alike():
    small = sheet_imager(sheet(side=SIDE / 8))
    maps, _ = scattered(own_maps(IMAGER), 0.2, sigma=0.2)
    scaled = own_maps(small)
    scaled[:, small.mask] = maps[:, IMAGER.mask] / 8
    assert torch.equal(small.mask, IMAGER.mask)
    assert torch.equal(left_out(judge(scaled, imager=small), small), left_out(judge(maps)))


def test_maps_that_hold_together_are_returned_as_they_are():
    mesh = tube()
    imager = imager_of(mesh)
    maps, _ = true_maps(imager, wrinkled(mesh, 3))
    judged = judge(maps, imager=imager)
    assert judged.positions is maps
    assert judged.confidence is None
    assert judged.findings.left_out.tolist() == [0, 0, 0]
    assert judged.findings.faults == [[], [], []]
    confidence = torch.rand(maps.shape[:-1])
    assert judge(maps, confidence, imager).confidence is confidence


def test_cloth_that_is_stretched_or_pressed_together_is_cloth():
    """To 1.9 times its length or a tenth; the size of the whole is said."""
    for factor in (1.9, 0.1):
        maps = own_maps(IMAGER)
        maps[..., 0] *= factor
        judged = judge(maps)
        assert judged.positions is maps
        assert judged.confidence is None


def test_rigid_motion_changes_nothing():
    maps, _ = scattered(own_maps(IMAGER), 0.2)
    maps[:, :, ROWS[0] : ROWS[0] + 6, COLUMNS[0] : COLUMNS[0] + 6, 2] += 0.1
    turn = torch.from_numpy(Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()).float()
    shift = torch.tensor([0.5, -1.0, 0.2])
    one, other = judge(maps), judge(maps @ turn.T + shift)
    assert torch.equal(one.confidence, other.confidence)
    torch.testing.assert_close(
        (one.positions @ turn.T + shift)[:, IMAGER.mask], other.positions[:, IMAGER.mask]
    )


def test_a_batch_equals_its_frames():
    maps, _ = scattered(own_maps(IMAGER, frames=3), 0.1)
    maps[1] = own_maps(IMAGER)[0]
    maps[2, :, :, COLUMNS[0] : COLUMNS[0] + 8, 2] += 0.1
    together = judge(maps)
    for frame in range(3):
        alone = judge(maps[frame : frame + 1])
        confidence = (
            torch.ones_like(together.confidence[:1]) if alone.confidence is None else alone.confidence
        )
        assert torch.equal(together.confidence[frame], confidence[0])
        assert torch.equal(together.positions[frame], alone.positions[0])
        assert together.findings.left_out[frame] == alone.findings.left_out[0]
        assert together.findings.faults[frame] == alone.findings.faults[0]


def test_a_confidence_that_is_given_multiplies_and_pixels_without_are_not_looked_at():
    maps = own_maps(IMAGER)
    good, bad, ignored = ((ROWS[0] + 4, COLUMNS[0] + k) for k in (3, 7, 11))
    maps[0, 0, *bad] += 0.2
    maps[0, 0, *ignored] -= 0.2
    confidence = torch.full(maps.shape[:-1], 0.5)
    confidence[0, 0, *ignored] = 0
    judged = judge(maps, confidence)
    values = [float(judged.confidence[0, 0, *place]) for place in (good, bad, ignored)]
    assert values == [0.5, 0, 0]
    np.testing.assert_allclose(judged.findings.left_out, 1 / (int(MASK.sum()) - 1))


def test_a_strip_one_pixel_wide_keeps_what_fits_half_of_its_neighbours():
    """Pixels beside the wrong one have one neighbour left, or another wrong one: it alone is left out."""
    imager = sheet_imager(Mesh(sheet().vertices * [1, 0.02, 1], sheet().faces), size=(9, 30))
    assert imager.mask[0].any(1).sum() == 1
    maps = own_maps(imager)
    row, columns = int(imager.mask[0].nonzero()[0, 0]), imager.mask[0].nonzero()[:, 1]
    maps[0, 0, row, columns[5]] += 0.2
    out = left_out(judge(maps, imager=imager), imager)
    assert out[0, 0, row].nonzero()[:, 0].tolist() == [int(columns[5])]


def test_a_pixel_without_neighbours_is_kept():
    maps = own_maps(IMAGER)
    confidence = torch.zeros(maps.shape[:-1])
    confidence[0, 0, ROWS[0] + 2, COLUMNS[0] + 2] = 1
    confidence[0, 0, ROWS[0] + 6 : ROWS[0] + 12] = 1
    maps[0, 0, ROWS[0] + 2, COLUMNS[0] + 2] += 0.2
    maps[0, 0, ROWS[0] + 8, COLUMNS[0] + 2] += 0.2
    judged = judge(maps, confidence)
    assert float(judged.confidence[0, 0, ROWS[0] + 2, COLUMNS[0] + 2]) == 1
    assert float(judged.confidence[0, 0, ROWS[0] + 8, COLUMNS[0] + 2]) == 0


def test_zeros_of_a_background_along_the_outline_are_left_out():
    """Two pixels deep, so that they fit each other but for being all at one place; the zero lies far from the cloth."""
    maps = own_maps(IMAGER) + torch.tensor([0.0, 0.0, 1.0])
    zeros = torch.zeros_like(IMAGER.mask)
    zeros[0, ROWS[0] : ROWS[0] + 2] = IMAGER.mask[0, ROWS[0] : ROWS[0] + 2]
    maps[:, zeros] = 0
    assert torch.equal(left_out(judge(maps))[0], zeros)


def test_noise_all_over_leaves_nothing_out():
    maps, _ = scattered(own_maps(IMAGER), 1.0)
    judged = judge(maps)
    assert judged.positions is maps
    assert judged.confidence is None
    assert [fault.kind for fault in judged.findings.faults[0]] == ["scale"]


def test_more_than_half_of_a_frame_is_never_left_out():
    """Three quarters are scaled fourfold: no two of their pixels fit, but nothing tells that the others are right."""
    maps = own_maps(IMAGER)
    maps[:, :, :, COLUMNS[0] + 6 :] *= 4
    judged = judge(maps)
    assert judged.confidence is None
    assert judged.findings.left_out.tolist() == [0]


def test_a_map_of_one_value_is_returned_as_it_is():
    maps = torch.ones_like(own_maps(IMAGER))
    judged = judge(maps)
    assert judged.confidence is None
    (fault,) = judged.findings.faults[0]
    assert (fault.kind, fault.scale) == ("scale", 0)
