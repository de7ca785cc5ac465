"""What a network is shown of the body, and the first guess that goes with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imgtransfer.network.base import BodyGuess, Guess
from imgtransfer.network.config import NetworkConfig
from imgtransfer.network.local_view import LocalView, TemplateView
from render import Mesh, PositionBox, TemplateImager, encode_normals, vertex_normals


def metric_maps(imager: TemplateImager, vertices: Tensor) -> tuple[Tensor, Tensor]:
    """(B, N, 3) metres -> position maps in metres and maps of unit vertex normals, (B, S, H, W, 3) each.

    Both in one product with the interpolation; 0 in the background, not encoded.
    """
    normals = vertex_normals(vertices, imager.faces.to(vertices.device))
    positions, normals = imager.operator(torch.cat([vertices, normals], dim=-1)).split(3, dim=-1)
    return positions, normals


@dataclass(frozen=True)
class ImagePair:
    """A position and a normal image of the same frames, encoded to [0, 1], background 0.

    Args:
        positions: (B, S, H, W, 3) float32.
        normals: (B, S, H, W, 3) float32.
    """

    positions: Tensor
    normals: Tensor

    @classmethod
    def encode(cls, positions: Tensor, normals: Tensor, mask: Tensor, box: PositionBox) -> ImagePair:
        """From metres and unit vectors, (B, S, H, W, 3) each; `mask` (S, H, W) keeps the background 0."""
        kept = mask[..., None]
        return cls(box.encode(positions) * kept, encode_normals(normals) * kept)


@dataclass(frozen=True)
class BodyMaps:
    """Posed bodies as a network sees them.

    Args:
        images: encoded images of the posed body by the garment's cameras.
        guess: the first guess, None where the network predicts absolute values.
        local: (B, S, rows, columns, K + 1, L, 3) float32, how the body around each patch has moved (`LocalView`); None
            where the network is shown the images.
        garment: the skinned garment's encoded images, with `network.garment: skinned`, in place of the template's.
        hidden: what the frozen trunks of both networks make of the images (`TransferNet.hidden`), where it is known.
    """

    images: ImagePair
    guess: Guess | None
    local: Tensor | None = None
    garment: ImagePair | None = None
    hidden: tuple[Tensor, Tensor] | None = None


class BodyImager:
    """Images posed bodies with the cameras of one garment; what is projected is always the same rest body.

    Args:
        garment: the garment's imager.
        body: the rest body, in the template's frame.
        shapes: templates (N, 3) and rest bodies (V, 3), metres, of the shapes that the posed bodies have; None for
            that of `garment` and `body` alone. Each takes some 100 bytes a pixel.
        box: of the garment's positions; the body's are encoded by the same.
        config: tells whether a first guess is wanted, and in which axes.
        device: where the maps are made.
        layout: of the body, where garment and body are laid out flat; None images it with the garment's cameras.

    Raises:
        InputError: the body lies outside of a view.
    """

    def __init__(
        self,
        garment: TemplateImager,
        body: Mesh,
        *,
        shapes: Sequence[tuple[np.ndarray, np.ndarray]] | None = None,
        box: PositionBox,
        config: NetworkConfig,
        device: torch.device,
        layout: Mesh | None = None,
    ) -> None:
        self.box = box
        if layout is None:
            self.imager = TemplateImager.build(body, cameras=garment.cameras)
        else:
            self.imager = TemplateImager.build(body, layout=layout, size=garment.size)
        self.mask = self.imager.mask.to(device)
        self._config, self._garment = config, garment
        self._guess: BodyGuess | None = None
        self.view: LocalView | None = None
        if config.target == "residual" and config.guess == "body":
            templates, bodies = zip(*(shapes or [(garment.mesh.vertices, body.vertices)]), strict=True)
            template, template_normals = metric_maps(garment, _float32(templates, device))
            rest, rest_normals = metric_maps(self.imager, _float32(bodies, device))
            self._guess = BodyGuess(
                mask=garment.mask.to(device),
                template_positions=template,
                template_normals=template_normals,
                body_mask=self.mask,
                projected=metric_maps(self.imager, _float32([body.vertices], device))[0][0],
                rest_positions=rest,
                rest_normals=rest_normals,
                frame=config.frame,
            )
            if config.body == "local":
                self.view = LocalView(
                    patch=config.vit.patch,
                    garment=garment,
                    body=self.imager,
                    templates=template,
                    normals=template_normals,
                    extended=self._guess.extend(rest),
                    rest=_float32(bodies, device),
                )

    @torch.no_grad()
    def __call__(
        self,
        vertices: Tensor,
        shape: Tensor | None = None,
        *,
        earlier: Tensor | None = None,
        up: Tensor | None = None,
        skinned: Tensor | None = None,
    ) -> BodyMaps:
        """Images of posed bodies, on the device of their vertices.

        Args:
            vertices: (B, V, 3) float32, metres, canonical frame.
            shape: (B,) int64, which of `shapes` each is; the first if None.
            earlier: (B, L - 1, J, 3) float32, metres, `LocalView.samples` of the body at the earlier times that the
                network is shown, in the canonical frame of the frame itself; none if None.
            up: (B, 3) float32, the vertical in the canonical frame; its y if None.
            skinned: (B, N, 12) float32, `skinned_garment` of the frames, where the configuration needs it.
        """
        positions, normals = metric_maps(self.imager, vertices)
        images = ImagePair.encode(positions, normals, self.mask, self.box)
        guess, worn = (None, None) if skinned is None else self._skinned(skinned)
        if self._guess is not None:
            guess = self._guess(positions, normals, shape)
        if self.view is None or guess is None:
            return BodyMaps(images, guess, garment=worn)
        samples = self.view.samples(vertices)[:, None]
        if earlier is not None:
            samples = torch.cat([samples, earlier], dim=1)
        if up is None:
            up = vertices.new_tensor([[0.0, 1.0, 0.0]]).expand(len(vertices), 3)
        return BodyMaps(images, guess, self.view(samples, guess, up, shape))

    def _skinned(self, skinned: Tensor) -> tuple[Guess | None, ImagePair | None]:
        """The skinned garment (B, N, 12) as first guess, and as images in place of the template, as far as wanted."""
        config, garment = self._config, self._garment
        positions, normals = metric_maps(garment, skinned[..., :3].contiguous())
        guess = worn = None
        if config.guess == "skinning":
            linear = garment.operator(skinned[..., 3:].contiguous()).unflatten(-1, (3, 3))
            guess = Guess(positions, normals, linear if config.frame == "body" else None)
        if config.garment == "skinned":
            worn = ImagePair.encode(positions, normals, garment.mask.to(positions.device), self.box)
        return guess, worn


def covered(maps: BodyMaps, garment: ImagePair | TemplateView) -> Tensor:
    """(B, P, K + 1, L, 3): what the P patches with cloth are told in some frames."""
    assert isinstance(garment, TemplateView)
    assert maps.local is not None
    return maps.local[:, garment.covered[0]]


def _float32(vertices: Sequence[np.ndarray], device: torch.device) -> Tensor:
    """K arrays (N, 3) -> (K, N, 3) float32."""
    return torch.from_numpy(np.stack(vertices).astype(np.float32)).to(device)
