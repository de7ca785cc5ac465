"""The body as a patch of cloth sees it: how what is around the patch has moved, in the patch's own axes.

A network that is shown the body's images in the canonical frame must learn for every patch of cloth anew which part of
the body is near it and how that part's frame turns. Here both are given: around every patch lie fixed places
(`network.places`), the body's motion is averaged there, and told relative to the rigid motion of the first guess at the
patch's centre. A patch whose surroundings move rigidly with it sees zeros, whatever the pose. All comes from the body's
images, at the frame and `network.history_s` earlier; no skinning weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor

from imgtransfer.network.base import Guess
from imgtransfer.network.local_frames import chosen
from imgtransfer.network.places import PLACES, mirrored_places, places
from render import TemplateImager
from render.mesh.sparse import SparseProduct

_FIELDS = 16  # the body's image is averaged over fields, so many along each side
# What nothing at a place weighs, where a sample right at it weighs 1: empty places read about 0.
_SPARSE = 0.05
TEMPLATE_CHANNELS = 10
FEATURES = (PLACES + 1) * 3  # numbers a patch and time
# The scale of template channels: offset from the body, and from the patch's centre.
OFFSET_M, STEP_M = 0.05, 0.1


@dataclass(frozen=True)
class TemplateView:
    """What the network is told of a garment that does not move.

    Args:
        images: (1, S, 10, H, W) float32: the template relative to the centre of its patch (3, in `STEP_M`), relative to
            the body (3, in `OFFSET_M`), its unit normal (3), and whether there is cloth; 0 off the silhouette.
        places: (1, S, rows, columns, 2 K) float32 in [0, 1): how much body and cloth is at each place around the patch.
        covered: (1, S, rows, columns) bool, which patches show any cloth.
    """

    images: Tensor
    places: Tensor
    covered: Tensor


class LocalView:
    """All that is constant about it for a garment on a body, in one shape or several.

    Args:
        patch: side of a square patch, pixels; (height, width) are multiples of it.
        garment: the template's imager. body: the rest body's, with the same cameras.
        templates: (N', S, H, W, 3) float32, metres, maps of the template in N' shapes.
        normals: (N', S, H, W, 3) float32, unit, its normals.
        extended: (N', S, H, W, 3) float32, metres, the rest bodies extended over the silhouette (`BodyGuess.extend`).
        rest: (N', V, 3) float32, metres, the rest bodies.
    """

    def __init__(
        self,
        *,
        patch: int,
        garment: TemplateImager,
        body: TemplateImager,
        templates: Tensor,
        normals: Tensor,
        extended: Tensor,
        rest: Tensor,
    ) -> None:
        self._body = _fields(body)
        self._grid = (garment.size[0] // patch, garment.size[1] // patch)
        projected = garment.operator(torch.from_numpy(garment.mesh.vertices))
        centre, at = token_centres(garment.mask.numpy(), projected.numpy(), patch)
        offsets, widths = places()
        target = centre[at >= 0][:, None] + offsets  # (P, K, 3), of the patches with cloth
        weights, body_amount = _weights(target, self._body(_double(body.mesh.vertices)).numpy(), widths)
        _, cloth_amount = _weights(target, _fields(garment)(_double(garment.mesh.vertices)).numpy(), widths)
        device = templates.device
        self._weights = torch.from_numpy(weights.astype(np.float32)).to(device)  # (P, K, J)
        self._total = self._weights.sum(-1)
        self._index = torch.from_numpy(at[at >= 0]).to(device)  # (P,)
        self._covered = torch.from_numpy(at >= 0).to(device)  # (S, M)
        self._rest = self._body(rest)  # (N', J, 3)
        self._centre = self._at_centres(templates)  # (N', P, 3)
        amounts = torch.from_numpy(np.concatenate([body_amount, cloth_amount], axis=-1)).float().to(device)
        self._amounts = self._over_grid(amounts[None])
        self._images = self._template_images(garment.mask.to(device), templates, normals, extended)

    def samples(self, vertices: Tensor) -> Tensor:
        """The body (..., V, 3), metres, in any frame -> means over the fields of its image, (..., J, 3)."""
        return self._body(vertices)

    def template(self) -> TemplateView:
        """What is told of the garment, in the first shape."""
        return TemplateView(self._images[:1], self._amounts, self._covered[None].unflatten(2, self._grid))

    def __call__(self, samples: Tensor, guess: Guess, up: Tensor, shape: Tensor | None = None) -> Tensor:
        """How the body around each patch has moved against the patch's own frame.

        Args:
            samples: (B, L, J, 3) float32, metres, of the body at the frame and at L - 1 earlier times, all in the
                frame's own canonical frame.
            guess: of the frames, with its rotations.
            up: (B, 3) the vertical in the canonical frame.
            shape: (B,) int64, which shape each is; the first if None.

        Returns:
            (B, S, rows, columns, K + 1, L, 3) float32, metres, in the patch's rest axes: at each place how far from a
            rigid motion, then how much farther at each of the earlier times; the last place has the vertical
            (unit, times 0.1) instead, and 0 for the earlier times. 0 for patches without cloth.
        """
        assert guess.rotation is not None  # the configuration sees to it
        turned = self._at_centres(guess.rotation.flatten(-2)).unflatten(-1, (3, 3))  # (B, P, 3, 3)
        anchor = self._at_centres(guess.positions)
        seen = torch.einsum("pkj,bljc->bpklc", self._weights, samples)
        seen = seen - (self._total[..., None] * anchor[..., None, :])[..., None, :]
        own = torch.einsum("bpji,bpklj->bpkli", turned, seen)
        rest, centre = chosen(self._rest, shape), chosen(self._centre, shape)
        at_rest = torch.einsum("pkj,bjc->bpkc", self._weights, rest)
        own = own - (at_rest - self._total[..., None] * centre[..., None, :])[..., None, :]
        now, earlier = own[..., :1, :], own[..., 1:, :]
        vertical = torch.einsum("bpji,bj->bpi", turned, up)
        last = torch.zeros_like(own[..., :1, :, :])
        last[..., 0, 0, :] = 0.1 * vertical
        return self._over_grid(torch.cat([torch.cat([now, earlier - now], dim=-2), last], dim=-3))

    def _over_grid(self, patches: Tensor) -> Tensor:
        """(B, P, ...) of the patches with cloth -> (B, S, rows, columns, ...), 0 for those without."""
        grid = patches.new_zeros(len(patches), *self._covered.shape, *patches.shape[2:])
        grid[:, self._covered] = patches
        return grid.unflatten(2, self._grid)

    def _at_centres(self, images: Tensor) -> Tensor:
        """(..., S, H, W, C) -> (..., P, C), read at the pixel nearest the centre of each patch with cloth."""
        return images.flatten(-4, -2)[..., self._index, :]

    def _template_images(self, mask: Tensor, templates: Tensor, normals: Tensor, extended: Tensor) -> Tensor:
        """(N', S, 10, H, W), see `TemplateView`."""
        patch = mask.shape[1] // self._grid[0]
        centre = self._over_grid(self._centre)
        centre = centre.repeat_interleave(patch, dim=-3).repeat_interleave(patch, dim=-2)
        kept = mask[..., None].float().expand(*templates.shape[:-1], 1)
        parts = [(templates - centre) / STEP_M, (templates - extended) / OFFSET_M, normals]
        return torch.cat([torch.cat(parts, dim=-1) * kept, kept], dim=-1).movedim(-1, -3).contiguous()


def mirrored_features(local: Tensor) -> Tensor:
    """What `LocalView` tells (B, S, rows, columns, K + 1, L, 3), for the mirrored figure in the mirrored motion."""
    order = np.append(mirrored_places(), PLACES)  # the vertical keeps its place
    sign = local.new_tensor([-1.0, 1.0, 1.0])
    return local.flip(3)[..., torch.from_numpy(order).to(local.device), :, :] * sign


def mirrored_template(template: TemplateView) -> TemplateView:
    """The mirrored garment on the mirrored body."""
    sign = template.images.new_tensor([-1, 1, 1, -1, 1, 1, -1, 1, 1, 1])
    order = torch.from_numpy(mirrored_places()).to(template.images.device)
    return TemplateView(
        template.images.flip(-1) * sign[:, None, None],
        template.places.flip(3)[..., torch.cat([order, order + PLACES])],
        template.covered.flip(3),
    )


def _double(vertices: np.ndarray) -> Tensor:
    return torch.from_numpy(np.asarray(vertices, np.float64))


def _fields(imager: TemplateImager) -> SparseProduct:
    """Means of vertices over square fields of the images, those that show anything: (..., V, C) -> (..., J, C)."""
    raster = imager.raster
    height, width = imager.size
    view, row, column = np.nonzero(raster.mask)
    field = (view * _FIELDS + row * _FIELDS // height) * _FIELDS + column * _FIELDS // width
    there, number, count = np.unique(field, return_inverse=True, return_counts=True)
    seen = raster.face_id[view, row, column]
    return SparseProduct(
        rows=np.repeat(number, 3),
        columns=imager.mesh.faces[seen].reshape(-1),
        values=(raster.barycentric[view, row, column] / count[number][:, None]).reshape(-1),
        shape=(len(there), len(imager.mesh.vertices)),
    )


def token_centres(mask: np.ndarray, projected: np.ndarray, patch: int) -> tuple[np.ndarray, np.ndarray]:
    """Of each patch the cloth nearest the mean of what it shows: where it is at rest, and its flat pixel index.

    Args:
        mask: (S, H, W) bool. projected: (S, H, W, 3) metres. patch: pixels.

    Returns:
        (S, M, 3) float64, 0 for patches without cloth; (S, M) int64, -1 for those.
    """
    views, height, width = mask.shape
    grid = (height // patch, width // patch)
    view, row, column = np.nonzero(mask)
    points = projected[mask]
    number = (view * grid[0] + row // patch) * grid[1] + column // patch
    count = np.bincount(number, minlength=views * grid[0] * grid[1])
    sums = np.stack([np.bincount(number, axis, minlength=len(count)) for axis in points.T], axis=-1)
    mean = sums / np.maximum(count, 1)[:, None]
    far = np.square(points - mean[number]).sum(-1)
    order = np.lexsort((far, number))
    first = np.unique(number[order], return_index=True)
    at = np.full(len(count), -1)
    centre = np.zeros((len(count), 3))
    chosen_pixels = order[first[1]]
    at[first[0]] = ((view * height + row) * width + column)[chosen_pixels]
    centre[first[0]] = points[chosen_pixels]
    shape = (views, grid[0] * grid[1])
    return centre.reshape(*shape, 3), at.reshape(shape)


def _weights(target: np.ndarray, samples: np.ndarray, widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much each sample counts at each place, and how much there is at the place.

    Args:
        target: (P, K, 3) metres. samples: (J, 3) metres. widths: (K,) metres.

    Returns:
        (P, K, J), a Gaussian mean that falls to 0 where few samples are near; (P, K) in [0, 1).
    """
    squared = cdist(target.reshape(-1, 3), samples, "sqeuclidean").reshape(*target.shape[:-1], -1)
    weight = np.exp(-squared / (2 * widths[:, None] ** 2))
    mass = weight.sum(-1)
    amount = mass / (mass + 1)
    return weight / (mass[..., None] + _SPARSE) * np.sqrt(amount)[..., None], amount
