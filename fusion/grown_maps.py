"""Maps grown over pixels of the template that their own mask lacks, or that are not to be trusted."""

from __future__ import annotations

import numpy as np
import torch

from fusion.robust.automatic_confidence import AutomaticConfidence, JudgedMaps
from render.errors import InputError
from render.maps.dilation import dilate, surface_guide, trusted_pixels
from render.maps.imager import TemplateImager

# Fraction of the template's pixels that the maps may lack: rasterisers differ in single pixels of the outline.
_TOLERATED = 0.01


class GrownMaps:
    """Images (T, S, H, W, C) with values wherever the template has pixels.

    Args:
        imager: of the template.
        mask: (S, H, W) bool, where the images have values.
        erode: pixels along the mask's outline not to trust.

    Raises:
        InputError: the mask is not the silhouette of the template, or `erode` is below 0.
    """

    def __init__(self, imager: TemplateImager, mask: np.ndarray, erode: int) -> None:
        needed = imager.mask.numpy()
        missing = float((needed & ~mask).sum() / needed.sum())
        if missing > _TOLERATED:
            raise InputError(
                f"{imager.mesh.source}: {100 * missing:.1f} % of its pixels lie outside the maps' silhouette; "
                "give the mesh that the maps were made with"
            )
        if erode < 0:
            raise InputError(f"erode is {erode}; pixels are counted from 0")
        self._mask, self._erode = mask, erode
        self._guide = surface_guide(imager) if erode or missing else None
        if self._guide is not None:
            self._trusted = trusted_pixels(mask, erode=erode, guide=self._guide)

    def __call__(self, images: np.ndarray) -> np.ndarray:
        """The images grown; themselves where nothing is to be grown over."""
        if self._guide is None:
            return images
        return dilate(images, self._mask, erode=self._erode, guide=self._guide)

    def judged(
        self, automatic: AutomaticConfidence, positions: torch.Tensor, confidence: torch.Tensor | None
    ) -> JudgedMaps:
        """Position maps judged by the pixels that nothing was grown over, and grown anew from those that are kept.

        Otherwise single wild pixels, which growing has spread, look as if they fitted, and parts that lie elsewhere are
        joined to their surroundings along the outline.

        Args:
            automatic: judges.
            positions: (T, S, H, W, 3) metres, grown.
            confidence: (T, S, H, W) at least 0; None: 1 everywhere.

        Returns:
            As `AutomaticConfidence.judge`, with the tensors given where nothing was found.
        """
        if self._guide is None:
            return automatic.judge(positions, confidence)
        given = torch.ones_like(positions[..., 0]) if confidence is None else confidence
        trusted = torch.from_numpy(self._trusted).to(positions.device)
        known = given * trusted
        judged = automatic.judge(positions, known)
        if judged.confidence is None or judged.confidence is known:
            return JudgedMaps(positions, confidence, judged.findings)
        factor = torch.where(known > 0, judged.confidence / known.clamp(min=1e-30), 1.0)
        both = torch.cat([judged.positions, factor[..., None]], -1)
        for frame in (factor != 1).flatten(1).any(1).nonzero()[:, 0].tolist():
            kept = self._trusted & (factor[frame] > 0).cpu().numpy()
            grown = dilate(both[frame], kept, guide=self._guide)
            both[frame] = torch.where(trusted[..., None], both[frame], grown)
        return JudgedMaps(both[..., :3].contiguous(), given * both[..., 3].clamp(0, 1), judged.findings)
