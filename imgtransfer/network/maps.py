"""What a network is shown of the body, and the first guess that goes with it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from imgtransfer.network.base import BodyGuess, Guess
from imgtransfer.network.config import NetworkConfig
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
    """

    images: ImagePair
    guess: Guess | None


class BodyImager:
    """Images posed bodies of one rest body with the cameras of one garment.

    Args:
        garment: the garment's imager.
        body: the rest body, in the template's frame.
        box: of the garment's positions; the body's are encoded by the same.
        config: tells whether a first guess is wanted, and in which axes.
        device: where the maps are made.

    Raises:
        InputError: the body lies outside of a view.
    """

    def __init__(
        self,
        garment: TemplateImager,
        body: Mesh,
        *,
        box: PositionBox,
        config: NetworkConfig,
        device: torch.device,
    ) -> None:
        self.box = box
        self.imager = TemplateImager.build(body, cameras=garment.cameras)
        self.mask = self.imager.mask.to(device)
        self._guess: BodyGuess | None = None
        if config.target == "residual":
            template, template_normals = metric_maps(garment, _float32(garment.mesh, device))
            rest, rest_normals = metric_maps(self.imager, _float32(body, device))
            self._guess = BodyGuess(
                mask=garment.mask.to(device),
                template_positions=template[0],
                template_normals=template_normals[0],
                body_mask=self.mask,
                rest_positions=rest[0],
                rest_normals=rest_normals[0],
                frame=config.frame,
            )

    @torch.no_grad()
    def __call__(self, vertices: Tensor) -> BodyMaps:
        """(B, V, 3) float32, metres, canonical frame -> the maps, on the device of `vertices`."""
        positions, normals = metric_maps(self.imager, vertices)
        images = ImagePair.encode(positions, normals, self.mask, self.box)
        return BodyMaps(images, None if self._guess is None else self._guess(positions, normals))


def _float32(mesh: Mesh, device: torch.device) -> Tensor:
    """(1, N, 3) float32."""
    return torch.as_tensor(mesh.vertices, dtype=torch.float32, device=device)[None]
