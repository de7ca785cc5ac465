"""Growing maps beyond their outline."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from fusion.initialise import initial_vertices
from render import InputError, TemplateImager
from render.maps.dilation import dilate, surface_guide
from tests.helpers.example_meshes import tube

KERNEL = np.ones((3, 3), np.uint8)
FOUR = ("front", "back", "left", "right")


def ramp(mask: np.ndarray) -> np.ndarray:
    """(S, H, W, 2): the affine images 2 x + 3 y + 1 and view - x, 0 outside the mask."""
    s, y, x = np.mgrid[tuple(slice(extent) for extent in mask.shape)].astype(float)
    return np.stack([2 * x + 3 * y + 1, s - x], -1) * mask[..., None]


def disc(radius: float = 8.0) -> np.ndarray:
    y, x = np.mgrid[:24, :28]
    return ((y - 11.5) ** 2 + (x - 14) ** 2 <= radius**2)[None]


def test_one_pixel_gives_its_value_to_all() -> None:
    mask = np.zeros((1, 3, 4), bool)
    mask[0, 1, 2] = True
    images = np.zeros((1, 3, 4, 1))
    images[0, 1, 2] = 7.0
    np.testing.assert_allclose(dilate(images, mask), 7.0)
    assert dilate(images, mask, pixels=1).sum() == 5 * 7.0  # itself and its four neighbours
    np.testing.assert_array_equal(dilate(images, mask, pixels=0), images)


def test_an_affine_image_goes_on() -> None:
    mask = np.concatenate([disc(), disc(6)])
    grown = dilate(ramp(mask), mask, pixels=2)
    ring = np.stack([cv2.dilate(view.astype(np.uint8), KERNEL) for view in mask]).astype(bool)
    np.testing.assert_allclose(grown[mask], ramp(mask)[mask])
    wrong = np.abs(grown - ramp(np.ones_like(mask)))[ring & ~mask]
    nearest = np.hypot(2, 3)  # how far the nearest pixel's value is off
    assert wrong.max() < 0.2 * nearest  # the damping holds back a little
    assert wrong.mean() < 0.05 * nearest
    far = np.stack([cv2.dilate(view.astype(np.uint8), KERNEL, iterations=3) for view in mask]) == 0
    assert (grown[far] == 0).all()


def test_far_values_stay_near_those_inside() -> None:
    mask = disc(4)
    images, grown = ramp(mask), dilate(ramp(mask), mask)
    spread = np.ptp(images[mask], axis=0)
    assert (grown >= images[mask].min(0) - spread).all()
    assert (grown <= images[mask].max(0) + spread).all()


def test_eroding_distrusts_the_outline_but_not_thin_parts() -> None:
    mask = disc()
    mask[0, 11:13, 22:28] = True  # a strap of two pixels' width, that no erosion leaves
    images = np.where(mask[..., None], 5.0, 0.0)
    inner = cv2.erode(disc()[0].astype(np.uint8), KERNEL).astype(bool)
    images[0, disc()[0] & ~inner] = 2.0
    grown = dilate(images, mask, erode=1)
    np.testing.assert_allclose(grown[0, disc()[0]], 5.0)
    np.testing.assert_allclose(grown[0, 11:13, 26:], 5.0)


def test_what_the_image_cuts_is_no_outline() -> None:
    images = np.arange(12.0).reshape(1, 3, 4, 1)
    np.testing.assert_array_equal(dilate(images, np.ones((1, 3, 4), bool), erode=1), images)


def test_a_view_without_pixels_is_left_alone() -> None:
    mask = np.concatenate([disc(), np.zeros_like(disc())])
    grown = dilate(ramp(mask), mask)
    assert (grown[1] == 0).all()
    assert (grown[0] != 0).any()


def test_tensors_batches_and_gradients() -> None:
    mask = disc(3)
    images = torch.randn(2, 3, *mask.shape, 2, dtype=torch.float64, requires_grad=True)
    grown = dilate(images, torch.from_numpy(mask))
    assert isinstance(grown, torch.Tensor)
    for a in range(2):
        single = dilate(images[a, 1].detach().numpy(), mask)
        np.testing.assert_allclose(grown[a, 1].detach().numpy(), single, atol=1e-12)
    small = torch.randn(1, 5, 6, 1, dtype=torch.float64, requires_grad=True)
    some = np.zeros((1, 5, 6), bool)
    some[0, 1:4, 1:5] = True
    assert torch.autograd.gradcheck(lambda x: dilate(x, some, erode=1), small)


def test_a_guide_makes_affinely_deformed_templates_exact_across_views() -> None:
    imager = TemplateImager.build(tube(40, 30), size=(64, 48), views=FOUR, backend="numpy")
    mask, guide = imager.raster.mask, surface_guide(imager)
    turned = torch.from_numpy(imager.mesh.vertices @ np.array([[1, 0.2, 0], [0, 1.1, 0.3], [-0.4, 0, 1]]) + 2)
    images = imager.operator(turned).numpy()
    less = np.stack([cv2.erode(view.astype(np.uint8), KERNEL) for view in mask]).astype(bool)
    grown = dilate(images * less[..., None], less, guide=guide)
    pixel = np.median(np.linalg.norm(np.diff(guide[0], axis=1), axis=-1)[less[0][:, 1:] & less[0][:, :-1]])
    assert np.abs(grown - images)[mask].mean() < 0.02 * pixel
    assert np.abs(grown - images)[mask].max() < 1.5 * pixel  # corners of the hem are extrapolated
    np.testing.assert_array_equal(grown[~mask], 0)


def folded(vertices: np.ndarray) -> np.ndarray:
    """A large bend and twist with folds of 5 mm: (N, 3) metres."""
    x, y, z = vertices.T
    turn = 0.8 * y
    x, z = x * np.cos(turn) + z * np.sin(turn), z * np.cos(turn) - x * np.sin(turn)
    bent = np.stack([(1 - x) * np.sin(y), (1 - x) * np.cos(y), z], -1)
    return bent + 0.005 * np.sin(25 * vertices @ np.array([1, 1, 0.5]))[:, None]


def untouched(images: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    return images, mask, 0


def blurred(images: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Mixed across the outline (and across the lines where one surface ends before another)."""
    return np.stack([gaussian_filter(view, (0.8, 0.8, 0)) for view in images]), mask, 2


def thinner(images: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """One pixel of outline less."""
    less = np.stack([cv2.erode(view.astype(np.uint8), KERNEL) for view in mask]).astype(bool)
    return images * less[..., None], less, 0


Spoil = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, int]]


def reading_errors(
    imager: TemplateImager, spoil: Spoil, *, mended: bool, noise: float = 0.0
) -> tuple[float, float]:
    """Mean error in mm of the vertices that a view sees within two pixels of its outline, and of the others."""
    mesh, mask, size = imager.mesh, imager.raster.mask, imager.size
    truth = folded(mesh.vertices)
    images, known, erode = spoil(imager.operator(torch.from_numpy(truth)).numpy(), mask)
    error = np.random.default_rng(0).normal(size=images.shape)
    error = np.stack([gaussian_filter(view, (2, 2, 0)) for view in error])  # as wide as a prediction's
    images = images + noise * error / error.std()
    if mended:
        images = dilate(images, known, erode=erode, guide=surface_guide(imager))
    outline = np.zeros_like(imager.visible)
    for s, camera in enumerate(imager.cameras):
        column, row = camera.project(mesh.vertices)[:, :2].T.astype(int).clip(0, size[0] - 1)
        inside = cv2.distanceTransform(mask[s].astype(np.uint8), cv2.DIST_L2, 5)[row, column]
        outline[s] = imager.visible[s] & (inside <= 2)
    at_outline, seen = outline.any(0), imager.visible.any(0)
    read = initial_vertices(imager, torch.from_numpy(images)).numpy()
    wrong = 1000 * np.linalg.norm(read - truth, axis=-1)
    return float(wrong[at_outline].mean()), float(wrong[seen & ~at_outline].mean())


@pytest.fixture(scope="module")
def four_views() -> TemplateImager:
    return TemplateImager.build(tube(90, 60), size=(160, 160), views=FOUR, backend="numpy")


@pytest.mark.parametrize(("spoil", "limit"), [(untouched, 1.0), (blurred, 1.15), (thinner, 1.1)])
def test_the_outline_is_read_as_well_as_the_rest(
    four_views: TemplateImager, spoil: Spoil, limit: float
) -> None:
    # Maps with a prediction's error, 3 mm. Mixed pixels are gone; those that were blurred are guessed.
    outline, elsewhere = reading_errors(four_views, spoil, mended=True, noise=0.003)
    assert outline < limit * elsewhere
    assert 3 < elsewhere < 5


@pytest.mark.parametrize(("spoil", "limit_mm"), [(blurred, 1.0), (thinner, 0.6)])
def test_without_any_noise_less_than_a_millimetre_is_left_of_decimetres(
    four_views: TemplateImager, spoil: Spoil, limit_mm: float
) -> None:
    outline, elsewhere = reading_errors(four_views, spoil, mended=True)
    assert outline < limit_mm
    assert reading_errors(four_views, spoil, mended=False)[0] > 60 * limit_mm
    assert elsewhere < limit_mm


def test_unusable_arguments_are_refused() -> None:
    mask, images = disc(), ramp(disc())
    with pytest.raises(InputError, match="images must have shape"):
        dilate(images[..., :5, :, :], mask)
    with pytest.raises(InputError, match="the mask must be bool"):
        dilate(images, mask.astype(float))
    with pytest.raises(InputError, match="no pixel to grow from"):
        dilate(images, np.zeros_like(mask))
    with pytest.raises(InputError, match="count from 0"):
        dilate(images, mask, erode=-1)
    with pytest.raises(InputError, match="guide must have shape"):
        dilate(images, mask, guide=np.zeros((2, 3)))
    with pytest.raises(InputError, match="no pixel in common"):
        dilate(images, mask, guide=np.full((*mask.shape, 3), np.nan))
