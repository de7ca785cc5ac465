"""The transfer network that sees the body from each patch of cloth (`network.local_view`), in place of its images.

Garment tokens and refinement are the paper's (section 3.2, equations 9 to 11); the body's tokens say how the
body around each patch has moved in that patch's own axes. Nothing is tied to one template: no position embedding, no
box, lengths in metres; where a patch is on the body and on the garment is told by what lies around it. The views see
each other, as the body's tokens and the garment's are those of all views. Patches without cloth take no part, and a
linear map makes each token its patch, where the paper's convolutions took half of a step's time on a CPU.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from imgtransfer.network.config import NetworkConfig
from imgtransfer.network.local_view import FEATURES, TEMPLATE_CHANNELS, TemplateView
from imgtransfer.network.patch_embedding import PatchEmbedding
from imgtransfer.network.places import PLACES
from imgtransfer.network.refinement import RefinementBlock
from imgtransfer.network.vit import VitBlock
from render import InputError

LEAST_SCALE_M = 1e-3  # of features: where nothing moved in the typical frames, noise is not made large


class TemplateEncoder(nn.Module):
    """The template at rest to tokens; they do not change while it is worn.

    Args:
        dim, depth, heads, patch: of `EncoderConfig`. dropout: of `NetworkConfig`.
    """

    def __init__(self, *, dim: int, depth: int, heads: int, patch: int, dropout: float) -> None:
        super().__init__()
        self.embed = PatchEmbedding(TEMPLATE_CHANNELS, dim, patch)
        self.around = nn.Linear(2 * PLACES, dim)
        self.blocks = nn.ModuleList(VitBlock(dim, heads, dropout) for _ in range(depth))

    def forward(self, template: TemplateView) -> Tensor:
        """(1, P, dim), of the patches with cloth in their order (`TemplateView.covered`)."""
        patches = self.embed(template.images[0])  # (S, rows, columns, dim)
        tokens = (patches + self.around(template.places[0]))[template.covered[0]][None]
        for block in self.blocks:
            tokens = block(tokens)
        return tokens


class LocalTransferNet(nn.Module):
    """f_p or f_n of equation 2, from the body around each patch.

    Args:
        config: sizes and switches, with `body: local`.
        size: (height, width) of the images, pixels.

    Raises:
        InputError: `size` is not a multiple of the patch.
    """

    scale: Tensor

    def __init__(self, config: NetworkConfig, size: tuple[int, int]) -> None:
        super().__init__()
        encoder = config.vit
        dim, patch = encoder.dim, encoder.patch
        if size[0] % patch or size[1] % patch:
            raise InputError(
                f"maps.size is {size[0]}x{size[1]} (height x width), not a multiple of the {patch}-pixel patch "
                "(network.encoder.patch); change one of the two"
            )
        self.config = config
        self.grid = (size[0] // patch, size[1] // patch)
        times = 1 + len(config.history_s)
        self.encoder = TemplateEncoder(
            dim=dim, depth=encoder.depth, heads=encoder.heads, patch=patch, dropout=config.dropout
        )
        self.motion = nn.Sequential(nn.Linear(FEATURES * times, dim), nn.GELU(), nn.Linear(dim, dim))
        self.norm_motion = nn.LayerNorm(dim)
        self.refinement = nn.ModuleList(
            RefinementBlock(dim, config.heads, config.dropout) for _ in range(config.blocks)
        )
        self.norm = nn.LayerNorm(dim)
        self.to_patch = nn.Linear(dim, 3 * patch**2)
        nn.init.zeros_(self.to_patch.weight)  # begins with the first guess
        nn.init.zeros_(self.to_patch.bias)
        self.register_buffer("scale", torch.full((PLACES + 1, times, 1), 0.05))

    def encode(self, template: TemplateView) -> Tensor:
        """(1, P, dim) tokens of the template's P patches with cloth, for `forward` and `patches`."""
        tokens: Tensor = self.encoder(template)
        return tokens

    def refined(self, tokens: Tensor, local: Tensor) -> Tensor:
        """(B, P, dim), the tokens that `patches` reads the residual from, with the same arguments."""
        motion = self.motion((local / self.scale).flatten(-3))
        garment = tokens + motion
        body = self.norm_motion(motion)
        for block in self.refinement:
            garment = block(garment, body)
        refined: Tensor = self.norm(garment)
        return refined

    def patches(self, tokens: Tensor, local: Tensor) -> Tensor:
        """Transfer a batch of frames, patch by patch.

        Args:
            tokens: (1 or B, P, dim), `encode` of the template.
            local: (B, P, K + 1, L, 3) float32, what `LocalView` tells of the frames, of the same patches.

        Returns:
            (B, P, patch, patch, 3) float32, the residual in the first guess's axes, see `network.residuals`.
        """
        side = self.config.vit.patch
        patches = self.to_patch(self.refined(tokens, local)).to(torch.float32)
        return patches.unflatten(-1, (side, side, 3))

    def forward(self, template: TemplateView, local: Tensor, *, tokens: Tensor | None = None) -> Tensor:
        """Transfer a batch of frames.

        Args:
            template: of the garment.
            local: (B, S, rows, columns, K + 1, L, 3) float32, what `LocalView` tells of the frames.
            tokens: `encode(template)` of an earlier call.

        Returns:
            (B, S, H, W, 3) float32, the residual in the first guess's axes, see `network.residuals`; 0 in patches
            without cloth. Values off the silhouette mean nothing.
        """
        tokens = self.encode(template) if tokens is None else tokens
        shown = template.covered[0]
        return patches_to_images(self.patches(tokens, local[:, shown]), shown)

    @torch.no_grad()
    def weaken(self, factor: float) -> None:
        """Multiply all residuals that it gives by a factor."""
        self.to_patch.weight.mul_(factor)
        self.to_patch.bias.mul_(factor)

    @torch.no_grad()
    def calibrate(self, typical: Sequence[Tensor]) -> None:
        """Take the features' scale at each place and time from typical frames.

        Args:
            typical: of each outfit (B, P, K + 1, L, 3), what its patches with cloth are told; all numbers count alike.
        """
        squared = torch.cat([told.square().mean(-1).flatten(0, 1) for told in typical]).mean(0)
        self.scale.copy_(squared.sqrt().clamp(min=LEAST_SCALE_M)[..., None])


def patches_to_images(patches: Tensor, covered: Tensor) -> Tensor:
    """(B, P, patch, patch, C) of the patches where `covered` (S, rows, columns) -> (B, S, H, W, C), 0 elsewhere."""
    grid = patches.new_zeros(len(patches), *covered.shape, *patches.shape[2:])
    grid[:, covered] = patches
    return grid.transpose(3, 4).flatten(4, 5).flatten(2, 3)


def images_to_patches(images: Tensor, covered: Tensor) -> Tensor:
    """(B, S, H, W, C) -> (B, P, patch, patch, C), the patches where `covered` (S, rows, columns)."""
    _, rows, columns = covered.shape
    return images.unflatten(3, (columns, -1)).unflatten(2, (rows, -1)).transpose(3, 4)[:, covered]
