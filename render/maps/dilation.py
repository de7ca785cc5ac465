"""Maps grown beyond their outline, so that reading them near a silhouette never meets the background."""

from __future__ import annotations

from typing import TypeVar

import cv2
import numpy as np
import torch
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from render.errors import InputError
from render.maps.imager import TemplateImager
from render.mesh.sparse import SparseProduct

Images = TypeVar("Images", np.ndarray, torch.Tensor)

_NEIGHBOURS = 32  # pixels from which one is grown: enough to fit a plane through noise
_FIT_DAMPING = 0.05  # pixels squared: keeps neighbours that lie (nearly) on a line from tilting the fit
_REACH = 4.0  # pixels: a fit is followed no farther than this beyond its neighbours' middle
_JUMP = 10.0  # pixels: neighbouring pixels farther apart on the template show different surfaces


def dilate(
    images: Images,
    mask: np.ndarray | torch.Tensor,
    *,
    pixels: int | None = None,
    erode: int = 0,
    guide: np.ndarray | None = None,
) -> Images:
    """Give pixels outside a mask values grown from inside.

    Each such pixel gets what a local affine fit through the nearest pixels inside says of it, so positions go
    on along the surface. Without a guide, near and affine mean in the image. With one they mean on the
    template: the neighbours may then come from another view, and where front and back view end at a flank,
    values between them are interpolated, not extrapolated.

    Args:
        images: (..., S, H, W, C) float32 or float64, array or tensor. Differentiable if a tensor.
        mask: (S, H, W) bool, where the values can be trusted.
        pixels: how far from the mask to grow; None: everywhere (with a guide: wherever it has values).
        erode: distrust this many pixels along the mask's outline too (blurred with the background) and, with
            a guide, along the lines where one surface of the template ends before another. Parts too thin to
            keep a pixel within 2 · `erode` + 2 stay as they are.
        guide: (S, H, W, G) where each pixel's point lies on the template (`surface_guide`), NaN where there
            is none; such pixels stay as they are.

    Returns:
        Like `images`; unchanged inside the eroded mask.

    Raises:
        InputError: shapes that do not fit, a negative number of pixels, or a mask without a pixel.
    """
    trusted = _trusted(mask)
    if tuple(images.shape[-4:-1]) != trusted.shape:
        raise InputError(
            f"dilate: images must have shape (..., {trusted.shape}, C), found {tuple(images.shape)}"
        )
    if erode < 0 or (pixels is not None and pixels < 0):
        raise InputError(f"dilate: pixels and erode count from 0, found {pixels} and {erode}")
    if guide is not None and (np.ndim(guide) != 4 or guide.shape[:3] != trusted.shape):
        raise InputError(f"dilate: the guide must have shape ({trusted.shape}, G), found {np.shape(guide)}")
    unit = 1.0 if guide is None else _step(guide)
    trusted = trusted_pixels(trusted, erode=erode, guide=guide)
    away = np.stack([_distance(view) for view in trusted])
    wanted = ~trusted & (away <= (np.inf if pixels is None else pixels))
    if guide is None:
        entries = _in_the_image(trusted, wanted, away)
    else:
        known = np.isfinite(guide).all(-1)
        entries = _on_the_template(guide / unit, trusted & known, wanted & known)
    return _applied(images, *entries)


def trusted_pixels(mask: np.ndarray, *, erode: int, guide: np.ndarray | None = None) -> np.ndarray:
    """The pixels from which `dilate` grows: (S, H, W) bool, the mask less what it does not trust."""
    if not erode:
        return mask
    jumps = None if guide is None else _jumps(guide, _JUMP * _step(guide))
    return _eroded(mask, erode, jumps)


def surface_guide(imager: TemplateImager) -> np.ndarray:
    """The point of the template that each pixel shows: (S, H, W, 3) float64, metres, NaN in the background."""
    points = imager.operator(torch.from_numpy(imager.mesh.vertices)).numpy()
    return np.where(imager.raster.mask[..., None], points, np.nan)


def _trusted(mask: np.ndarray | torch.Tensor) -> np.ndarray:
    array = np.asarray(mask.cpu() if isinstance(mask, torch.Tensor) else mask)
    if array.ndim != 3 or array.dtype != np.bool_:
        raise InputError(f"dilate: the mask must be bool (S, H, W), found {array.dtype} {array.shape}")
    if not array.any():
        raise InputError("dilate: the mask has no pixel to grow from")
    return array


def _step(guide: np.ndarray) -> float:
    """How far apart neighbouring pixels are on the template: the median along rows."""
    steps = np.linalg.norm(np.diff(guide, axis=2), axis=-1)
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) and np.median(steps) > 0 else 1.0


def _jumps(guide: np.ndarray, limit: float) -> np.ndarray:
    """(S, H, W) bool, pixels with a neighbour in their row or column that is farther than `limit` away."""
    jumping = np.zeros(guide.shape[:3], bool)
    with np.errstate(invalid="ignore"):
        down = np.linalg.norm(np.diff(guide, axis=1), axis=-1) > limit
        across = np.linalg.norm(np.diff(guide, axis=2), axis=-1) > limit
    jumping[:, 1:] |= down
    jumping[:, :-1] |= down
    jumping[:, :, 1:] |= across
    jumping[:, :, :-1] |= across
    return jumping


def _eroded(mask: np.ndarray, erode: int, jumps: np.ndarray | None) -> np.ndarray:
    """The mask less `erode` pixels from the background, and from surfaces that end before others."""
    kernel = np.ones((3, 3), np.uint8)
    left = []
    for view, covered in enumerate(mask):
        # The image's border is none of the mask's: what is cut there goes on outside.
        kept = cv2.erode(covered.astype(np.uint8), kernel, iterations=erode).astype(bool)
        kept |= covered & (_distance(kept) > 2 * erode + 2)
        if jumps is not None:
            kept &= cv2.dilate(jumps[view].astype(np.uint8), kernel, iterations=erode - 1) == 0
        left.append(kept)
    return np.stack(left)


def _distance(mask: np.ndarray) -> np.ndarray:
    """(H, W) pixels to the nearest one of the mask, 0 inside; infinite if it has none."""
    return distance_transform_edt(~mask) if mask.any() else np.full(mask.shape, np.inf)


_Entries = tuple[np.ndarray, np.ndarray, np.ndarray]  # target pixels (P,), their sources and weights (P, K)


def _on_the_template(guide: np.ndarray, trusted: np.ndarray, wanted: np.ndarray) -> _Entries:
    """Weights over the nearest trusted pixels of all views; `guide` in units of a pixel."""
    if not trusted.any():
        raise InputError("dilate: the mask and the guide have no pixel in common")
    return _grown(guide.reshape(-1, guide.shape[-1]), trusted.reshape(-1), wanted.reshape(-1))


def _in_the_image(trusted: np.ndarray, wanted: np.ndarray, away: np.ndarray) -> _Entries:
    """Weights over the nearest trusted pixels of the same view; far away the nearest one's value only."""
    place = np.argwhere(np.ones(trusted.shape[1:], bool)).astype(np.float64)  # (H * W, 2), row by row
    parts = []
    for view in range(len(trusted)):
        if not trusted[view].any():
            continue
        near = wanted[view] & (away[view] <= _REACH)
        parts.append((view, *_grown(place, trusted[view].reshape(-1), near.reshape(-1))))
        rows, columns = np.nonzero(wanted[view] & ~near)
        nearest = distance_transform_edt(~trusted[view], return_distances=False, return_indices=True)
        source = np.ravel_multi_index(tuple(nearest[:, rows, columns]), trusted[view].shape)
        sources = np.repeat(source[:, None], _NEIGHBOURS, axis=1)
        weights = np.full(sources.shape, 1 / _NEIGHBOURS)
        parts.append((view, rows * trusted.shape[2] + columns, sources, weights))
    size = trusted[0].size
    targets = np.concatenate([view * size + target for view, target, _, _ in parts])
    sources = np.concatenate([view * size + source for view, _, source, _ in parts])
    return targets, sources, np.concatenate([weights for _, _, _, weights in parts])


def _grown(place: np.ndarray, trusted: np.ndarray, wanted: np.ndarray) -> _Entries:
    """Damped least squares affine fits: weights (P, K) of sum 1 over the K nearest trusted points.

    Args:
        place: (Q, G) coordinates in units of a pixel; trusted, wanted: (Q,) bool.
    """
    targets, known = np.flatnonzero(wanted), np.flatnonzero(trusted)
    sources = np.zeros((len(targets), _NEIGHBOURS), np.int64)
    if len(targets) == 0:
        return targets, sources, np.zeros(sources.shape)
    distance, nearest = cKDTree(place[known]).query(place[targets], k=_NEIGHBOURS)
    near = np.isfinite(distance)  # a small mask has fewer
    sources[near] = known[nearest[near]]
    distance = np.where(near, distance, 0)
    width = distance.sum(1, keepdims=True) / near.sum(1, keepdims=True)
    weights = np.exp(-0.5 * (distance / np.maximum(width, 1e-9)) ** 2) * near
    weights /= weights.sum(1, keepdims=True)
    relative = place[sources] - place[targets][:, None]
    middle = (relative * weights[..., None]).sum(1)
    spread = relative - middle[:, None]
    gram = np.einsum("pk,pki,pkj->pij", weights, spread, spread) + _FIT_DAMPING * np.eye(place.shape[1])
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    step = -middle * np.minimum(1, (_REACH + width) / np.maximum(length, 1e-9))
    slope = np.linalg.solve(gram, step[..., None])[..., 0]
    return targets, sources, weights * (1 + np.einsum("pki,pi->pk", spread, slope))


def _applied(images: Images, targets: np.ndarray, sources: np.ndarray, weights: np.ndarray) -> Images:
    if len(targets) == 0:
        return images
    if isinstance(images, np.ndarray):
        return _applied(torch.from_numpy(images), targets, sources, weights).numpy()
    pixels = images.reshape(*images.shape[:-4], -1, images.shape[-1])
    rows = np.repeat(np.arange(len(targets)), sources.shape[1])
    growth = SparseProduct(rows, sources.ravel(), weights.ravel(), (len(targets), pixels.shape[-2]))
    places = torch.from_numpy(targets).to(images.device)
    return pixels.index_copy(-2, places, growth(pixels)).reshape(images.shape)
