"""What local networks are trained on, patch by patch: the body around each, and the residual that is wanted there.

The loss is taken of residuals in the first guess's axes, where `network.body: images` takes it of whole images: no
frame's images need then be put together, and what a frame shows is the same in every step, so that it is made once
(`training.prepared`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imgtransfer.network.base import Guess
from imgtransfer.network.local_transfer import images_to_patches
from imgtransfer.network.local_view import TemplateView, mirrored_template
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.places import PLACES, mirrored_places
from imgtransfer.network.residuals import NORMAL_RESIDUAL, POSITION_RESIDUAL_M
from imgtransfer.training.head_fit import turned_back
from imgtransfer.training.outfits import Outfit
from render import decode_normals

CHANNELS = 6  # of a pixel: the residual of positions and of normals


@dataclass(frozen=True)
class PatchTemplate:
    """An outfit's template as its P patches with cloth.

    Args:
        views: what the networks are told of it; the mirrored one after it where the run mirrors.
        mask: (P, patch, patch) bool, the silhouette.
        order: (P,) int64, of each patch of the mirrored template, which patch it mirrors.
    """

    views: tuple[TemplateView, ...]
    mask: Tensor
    order: Tensor

    @classmethod
    def of(cls, outfit: Outfit) -> PatchTemplate:
        """That of an outfit whose model is local."""
        view = outfit.garment
        assert isinstance(view, TemplateView)
        shown = view.covered[0]
        mask = images_to_patches(outfit.model.mask[None, ..., None], shown)[0, ..., 0]
        number = torch.full(shown.shape, -1)
        number[shown] = torch.arange(int(shown.sum()), device=number.device)
        views = (view,) if outfit.mirror is None else (view, mirrored_template(view))
        return cls(views, mask, number.flip(-1)[shown.flip(-1)].to(mask.device))


@dataclass(frozen=True)
class PatchFrames:
    """B frames of an outfit.

    Args:
        local: (B, P, K + 1, L, 3) float32, what the networks are told (`LocalView`).
        residuals: (B, P, patch, patch, 6) float32, what they should say: of positions in `POSITION_RESIDUAL_M`, of
            normals in `NORMAL_RESIDUAL`, in the first guess's axes.
    """

    local: Tensor
    residuals: Tensor

    @classmethod
    def of(cls, outfit: Outfit, body: BodyMaps, truth: ImagePair) -> PatchFrames:
        """Frames of an outfit from its maps."""
        view, guess = outfit.garment, body.guess
        assert isinstance(view, TemplateView)
        assert guess is not None
        assert body.local is not None
        shown = view.covered[0]
        guess = _in_patches(guess, shown)  # before it is turned, as most of an image is background
        positions = images_to_patches(outfit.model.box.decode(truth.positions), shown) - guess.positions
        normals = images_to_patches(decode_normals(truth.normals), shown) - guess.normals
        both = [
            turned_back(guess, positions) / POSITION_RESIDUAL_M,
            turned_back(guess, normals) / NORMAL_RESIDUAL,
        ]
        mask = images_to_patches(outfit.model.mask[None, ..., None], shown)
        residuals = torch.cat(both, dim=-1) * mask  # nothing large in the background
        return cls(body.local[:, shown], residuals)

    def mirrored(self, template: PatchTemplate, frames: Tensor) -> PatchFrames:
        """With those mirrored where `frames` (B,) is true, their patches in the order of the mirrored template's."""
        places = torch.from_numpy(np.append(mirrored_places(), PLACES)).to(
            self.local.device
        )  # the vertical stays
        sign = self.local.new_tensor([-1.0, 1.0, 1.0])
        local = self.local[:, template.order][:, :, places] * sign
        residuals = self.residuals[:, template.order].flip(3) * sign.repeat(2)
        where = frames[:, None, None, None, None]
        return PatchFrames(
            torch.where(where, local, self.local), torch.where(where, residuals, self.residuals)
        )


def _in_patches(guess: Guess, covered: Tensor) -> Guess:
    """The guess at the pixels of the patches where `covered` (S, rows, columns), (B, P, patch, patch, ...) each."""
    rotation = guess.rotation
    if rotation is not None:
        rotation = images_to_patches(rotation.flatten(-2), covered).unflatten(-1, (3, 3))
    return Guess(
        images_to_patches(guess.positions, covered), images_to_patches(guess.normals, covered), rotation
    )


def patch_masks(template: PatchTemplate, frames: Tensor) -> Tensor:
    """(B, P, patch, patch) bool, the silhouette in frames of which those where `frames` (B,) are mirrored."""
    mirrored = template.mask[template.order].flip(2)
    return torch.where(frames[:, None, None, None], mirrored, template.mask)
