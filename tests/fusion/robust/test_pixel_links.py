"""Which pixels are neighbours on one surface, and when a step between them fits."""

import itertools

import numpy as np
import pytest
import torch

from fusion.robust.pixel_links import PixelLinks
from render import Mesh, TemplateImager
from tests.helpers.example_meshes import two_quads
from tests.helpers.sheets import SIDE, own_maps, sheet, sheet_imager

CPU = torch.device("cpu")


def links_of(imager, rest=None):
    return PixelLinks(imager, rest or imager.mesh, CPU)


def covered(imager, maps):
    return maps[0][imager.mask].numpy()


def test_links_are_those_of_a_plain_loop():
    imager = sheet_imager(size=(12, 14))
    links = links_of(imager)
    mask = imager.mask[0].numpy()
    number = np.cumsum(mask).reshape(mask.shape) - 1
    wanted = set()
    for row, column in zip(*np.nonzero(mask), strict=True):
        for down, right in itertools.product((-1, 0, 1), repeat=2):
            other = row + down, column + right
            inside = 0 <= other[0] < mask.shape[0] and 0 <= other[1] < mask.shape[1]
            if (down or right) and inside and mask[other]:
                wanted.add(frozenset((number[row, column], number[other])))
    made = [frozenset(pair) for pair in zip(links.first.tolist(), links.second.tolist(), strict=True)]
    assert len(made) == len(set(made))
    assert set(made) == wanted


def test_lengths_are_metres_on_the_garment_at_rest():
    """A flat sheet from the front: neighbours are one footprint apart, or √2 of it; twice for a rest twice as large."""
    imager = sheet_imager()
    links = links_of(imager)
    points = covered(imager, own_maps(imager))
    np.testing.assert_allclose(
        links.length, np.linalg.norm(points[links.first] - points[links.second], axis=1), rtol=1e-4
    )
    assert set(np.round(links.length / links.footprint, 3)) == {1.0, round(np.sqrt(2), 3)}
    twice = links_of(imager, Mesh(2 * imager.mesh.vertices, imager.mesh.faces))
    np.testing.assert_allclose(twice.length, 2 * links.length)
    assert twice.footprint == pytest.approx(2 * links.footprint)


@pytest.mark.parametrize(("steps", "fit"), [(0.01, False), (0.5, True), (1, True), (2.9, True), (3.1, False)])
def test_a_step_fits_from_a_fiftieth_to_twice_the_template_s_and_the_slack(steps, fit):
    """Along rows the template's step is one footprint f, and so is the slack here: 2 f + f is the longest that fits."""
    imager = sheet_imager()
    links = links_of(imager)
    points = covered(imager, own_maps(imager))
    right = np.flatnonzero(np.abs(points[links.first] - points[links.second])[:, 1] < 1e-6)
    moved = points.copy()
    tenth = np.median(points[:, 0])  # only one column is stretched, so that the map is not noisy
    moved[:, 0] += (points[:, 0] > tenth) * (steps - 1) * links.footprint
    across = right[(points[links.first[right], 0] > tenth) != (points[links.second[right], 0] > tenth)]
    counts, fits = links.fitting(moved)
    assert counts.all()
    assert len(across) > 5
    assert (fits[across] == fit).all()
    assert fits.mean() > 0.8


@pytest.mark.parametrize(
    ("cells", "footprints"), [(24, 1), (8, None), (1, 5)], ids=["coarse", "edge", "fine"]
)
def test_the_slack_is_an_edge_but_from_one_footprint_to_five(cells, footprints):
    links = links_of(sheet_imager(sheet(cells)))
    assert links.slack == pytest.approx(links.footprint * footprints if footprints else SIDE / cells)


def test_a_quick_look_finds_the_frames_with_a_step_that_does_not_fit():
    imager = sheet_imager()
    maps = own_maps(imager, frames=3)
    row, column = (int(values[len(values) // 2]) for values in imager.mask[0].nonzero(as_tuple=True))
    maps[1, 0, row, column] += 0.2
    maps[2, 0, 0, 0] = 9.0  # in the background
    links = links_of(imager)
    assert links.unfit(maps).tolist() == [False, True, False]
    known = torch.ones(maps.shape[:-1], dtype=torch.bool)
    known[:, 0, row, column] = False
    assert links.unfit(maps, known).tolist() == [False, False, False]


def test_a_map_that_is_noisy_all_over_fits():
    imager = sheet_imager()
    links = links_of(imager)
    points = covered(imager, own_maps(imager))
    noise = np.random.default_rng(0).normal(0, 3 * links.footprint, points.shape).astype(np.float32)
    assert links.fitting(points + noise)[1].mean() > 0.99


def test_pieces_that_are_not_joined_have_no_links_between_them():
    """A square before another: their pixels are neighbours in the image, and near enough on the template."""
    # The smaller one is behind, so that the back shows both.
    imager = TemplateImager.build(two_quads(gap=0.01), views=("back",), size=(24, 24), backend="numpy")
    links = links_of(imager)
    faces = imager.raster.face_id.reshape(-1)[links.pixels]
    between = (faces[links.first] < 2) != (faces[links.second] < 2)
    assert between.any()
    assert (links.joined == ~between).all()


def test_cloth_that_lies_on_itself_is_not_linked_across_the_fold():
    """A strip folded back over itself: near on the template and in the image, but far along the cloth."""
    line = np.linspace(0, 0.5, 51)
    x, z = np.where(line < 0.3, line, 0.6 - line), np.where(line < 0.3, 0.0, 0.01)
    strip = np.stack([np.stack([x, np.full_like(x, y), z], 1) for y in (0.0, 0.1)])
    a = np.arange(50)
    faces = np.concatenate([np.stack([a, a + 1, a + 52], 1), np.stack([a, a + 52, a + 51], 1)])
    imager = sheet_imager(Mesh(strip.reshape(-1, 3), faces), size=(40, 48))
    links = links_of(imager)
    faces = imager.raster.face_id.reshape(-1)[links.pixels] % 50
    far = np.abs(faces[links.first] - faces[links.second]) > 20
    assert far.any()
    assert not links.joined[far].any()
    assert links.joined[~far].mean() > 0.95


def test_a_template_of_one_pixel_has_no_links():
    links = links_of(sheet_imager(size=(1, 1)))
    assert len(links.first) == 0
    assert links.footprint == 0
    assert links.unfit(torch.zeros(2, 1, 1, 1, 3)).tolist() == [False, False]
