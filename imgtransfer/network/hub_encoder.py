"""Pretrained encoders: images to tokens by a model of `transformers`, of which the last blocks are trained."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from imgtransfer.network.encoder_config import HubEncoderConfig
from imgtransfer.network.hub_checkpoint import (
    checkpoint_folder,
    empty_model,
    hub_config,
    kept_values,
    pretrained_model,
    read_config,
)
from render import InputError

_MEAN, _STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, as all of these were trained with


class HubEncoder(nn.Module):
    """What pretrained encoders have in common: a frozen trunk, then blocks that are trained, then a projection.

    The model of `transformers` is always in evaluation mode: nothing is dropped out, no statistics are taken.

    Args:
        hub: the model.
        features: its own width.
        patch: pixels of the map along a side of a token, a power of two.
        own_patch: pixels of the image that the model sees along a side of a token. Where it is another than `patch`,
            such as 14, the map is resized.
        size: (height, width) of the maps, pixels.
        blocks: of the model. trained: the last so many are trained, and what follows them.
        dim: to project to; None for `features`.

    Raises:
        InputError: `size` is not a multiple of `patch`, the decoder cannot halve `dim` often enough, or more blocks are
            to be trained than there are.

    Attributes:
        dim: width of the tokens. features: of the model itself.
        grid: (rows, columns) of patches.
    """

    mean: Tensor
    std: Tensor
    prefix = 1  # tokens before those of the patches

    def __init__(
        self,
        hub: Any,
        *,
        features: int,
        patch: int,
        own_patch: int,
        size: tuple[int, int],
        blocks: int,
        trained: int,
        dim: int | None,
    ) -> None:
        super().__init__()
        kind = _kind(hub)
        if size[0] % patch or size[1] % patch:
            raise InputError(
                f"maps.size is {size[0]}x{size[1]} (height x width), not a multiple of the {patch} pixels of a token "
                f"of {kind} (network.encoder); change one of the two"
            )
        if trained > blocks:
            raise InputError(f"network.encoder.trained_blocks is {trained}, and {kind} has {blocks}")
        self.dim, self.features, self.patch, self.size = dim or features, features, patch, size
        if self.dim % patch:
            raise InputError(
                f"network.encoder: tokens of {self.dim} features are not a multiple of {patch}, and the decoder halves "
                f"them log2({patch}) times; set network.encoder.dim"
            )
        self.grid = (size[0] // patch, size[1] // patch)
        self.image = (self.grid[0] * own_patch, self.grid[1] * own_patch)
        self.first_trained = blocks - trained
        self.hub = hub.requires_grad_(False).eval()
        self.project = nn.Linear(features, self.dim) if self.dim != features else nn.Identity()
        for name, values in (("mean", _MEAN), ("std", _STD)):
            self.register_buffer(name, torch.tensor(values)[:, None, None], persistent=False)

    def trunk(self, images: Tensor) -> Tensor:
        """What the frozen part makes of (B, 3, H, W) images in [0, 1]: (B, ...) without gradient, for `tail`."""
        raise NotImplementedError

    def tail(self, hidden: Tensor) -> Tensor:
        """(B, ...) of `trunk` -> (B, prefix + rows * columns, dim) tokens."""
        raise NotImplementedError

    def forward(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) in [0, 1] -> (B, prefix + rows * columns, dim): [CLS] and registers, then patches row by row.

        Raises:
            InputError: the images are not of the encoder's size.
        """
        if tuple(images.shape[-2:]) != self.size:
            raise InputError(
                f"images are {images.shape[-2]}x{images.shape[-1]} (height x width), "
                f"but the encoder was made for {self.size[0]}x{self.size[1]}"
            )
        return self.tail(self.trunk(images))

    def train(self, mode: bool = True) -> HubEncoder:
        """As for any module, but that the pretrained part stays as in evaluation."""
        super().train(mode)
        self.hub.eval()
        return self

    @property
    def architecture(self) -> dict[str, Any]:
        """What `build_hub_encoder` makes the same encoder of, without weights."""
        return kept_values(self.hub.config)

    def _normalised(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) in [0, 1] as the model was trained with, in the size that it sees."""
        if self.image != self.size:
            images = functional.interpolate(images, self.image, mode="bilinear", antialias=True)
        return (images - self.mean) / self.std


class HubVit(HubEncoder):
    """A vision transformer: DINO, DINOv2 with and without registers, DINOv3.

    Position embeddings are interpolated to the grid of the maps once; DINOv3 turns queries and keys by place instead.

    Args:
        hub, size, trained, dim: see `HubEncoder`.
    """

    def __init__(self, hub: Any, *, size: tuple[int, int], trained: int, dim: int | None) -> None:
        config = hub.config
        if not isinstance(config.patch_size, int):
            raise InputError(f"{_kind(hub)}: square patches are wanted, found {config.patch_size}")
        super().__init__(
            hub,
            features=config.hidden_size,
            patch=1 << (config.patch_size - 1).bit_length(),
            own_patch=config.patch_size,
            size=size,
            blocks=len(_blocks(hub)),
            trained=trained,
            dim=dim,
        )
        embeddings = hub.embeddings
        embeddings.mask_token = None  # of its pretraining
        self.prefix = 1 + getattr(config, "num_register_tokens", 0)
        if hasattr(embeddings, "position_embeddings"):
            smooth = config.model_type == "dinov2_with_registers"  # as it was trained
            placed = _interpolated(embeddings.position_embeddings, _grid(config), self.grid, smooth)
            embeddings.position_embeddings = nn.Parameter(placed, requires_grad=False)
        config.image_size = list(self.image)
        for module in (*_blocks(hub)[self.first_trained :], _norm(hub)):
            module.requires_grad_(True)

    @torch.no_grad()
    def trunk(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) -> (B, prefix + rows * columns, features)."""
        embeddings, images = self.hub.embeddings, self._normalised(images)
        patches = embeddings.patch_embeddings
        tokens = getattr(patches, "projection", patches)(images).flatten(2).mT
        before = [embeddings.cls_token.expand(len(tokens), -1, -1)]
        if hasattr(embeddings, "position_embeddings"):
            places = embeddings.position_embeddings
            tokens, before[0] = tokens + places[:, 1:], before[0] + places[:, :1]
        if self.prefix > 1:
            before.append(embeddings.register_tokens.expand(len(tokens), -1, -1))
        tokens = torch.cat([*(token.to(tokens) for token in before), tokens], dim=1)
        return self._through(slice(0, self.first_trained), tokens)

    def tail(self, hidden: Tensor) -> Tensor:
        """(B, prefix + rows * columns, features) -> (B, prefix + rows * columns, dim)."""
        tokens = self._through(slice(self.first_trained, None), hidden)
        projected: Tensor = self.project(_norm(self.hub)(tokens))
        return projected

    def _through(self, some: slice, tokens: Tensor) -> Tensor:
        """Tokens through some of the blocks."""
        turned = {}
        if hasattr(self.hub, "rope_embeddings"):  # of which only size, type and place of an image count
            turned["position_embeddings"] = self.hub.rope_embeddings(tokens.new_empty(1, 1, *self.image))
        for block in _blocks(self.hub)[some]:
            tokens = block(tokens, **turned)
        return tokens


class FrozenBatchNorm(nn.Module):
    """Batch normalisation by the statistics of the pretraining.

    Args:
        norm: whose statistics.
    """

    weight: Tensor
    bias: Tensor
    running_mean: Tensor
    running_var: Tensor

    def __init__(self, norm: nn.BatchNorm2d) -> None:
        super().__init__()
        self.eps = norm.eps
        for name in ("weight", "bias", "running_mean", "running_var"):
            self.register_buffer(name, getattr(norm, name).detach())

    def forward(self, features: Tensor) -> Tensor:
        """(B, C, h, w), each channel by its own statistics."""
        scale = self.weight * (self.running_var + self.eps).rsqrt()
        shift = self.bias - self.running_mean * scale
        return features * scale[:, None, None] + shift[:, None, None]


class HubResNet(HubEncoder):
    """A ResNet, the paper's ablation (table 4): its last map of features as tokens, their mean in place of [CLS].

    Args:
        hub, size, trained, dim: see `HubEncoder`; a block is a residual layer of any stage.
    """

    def __init__(self, hub: Any, *, size: tuple[int, int], trained: int, dim: int | None) -> None:
        config = hub.config
        stride = 2 ** (1 + len(config.hidden_sizes) + config.downsample_in_first_stage)
        super().__init__(
            hub,
            features=config.hidden_sizes[-1],
            patch=stride,
            own_patch=stride,
            size=size,
            blocks=sum(config.depths),
            trained=trained,
            dim=dim,
        )
        _freeze_statistics(hub)
        for layer in self._layers()[self.first_trained :]:
            layer.requires_grad_(True)

    @torch.no_grad()
    def trunk(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) -> (B, channels, h, w) of the last layer that is frozen."""
        features: Tensor = self.hub.embedder(self._normalised(images))
        for layer in self._layers()[: self.first_trained]:
            features = layer(features)
        return features

    def tail(self, hidden: Tensor) -> Tensor:
        """(B, channels, h, w) -> (B, 1 + rows * columns, dim)."""
        for layer in self._layers()[self.first_trained :]:
            hidden = layer(hidden)
        patches = hidden.flatten(2).mT
        projected: Tensor = self.project(torch.cat([patches.mean(1, keepdim=True), patches], dim=1))
        return projected

    def _layers(self) -> list[nn.Module]:
        return [layer for stage in self.hub.encoder.stages for layer in stage.layers]


def build_hub_encoder(
    config: HubEncoderConfig, size: tuple[int, int], architecture: dict[str, Any] | None = None
) -> HubEncoder:
    """The encoder that `config` names, for maps of `size` (height, width).

    Args:
        architecture: of an encoder whose weights are to follow, as its model's file has it; None reads the checkpoint.

    Raises:
        InputError: no checkpoint, one that cannot be read, or sizes that do not suit.
    """
    if architecture is None:
        folder = checkpoint_folder(config.name)
        hub = pretrained_model(folder, read_config(folder))
    else:
        hub = empty_model(hub_config(architecture, config.name))
    return _encoder(hub, config, size)


def outline(
    config: HubEncoderConfig, size: tuple[int, int], architecture: dict[str, Any] | None = None
) -> HubEncoder:
    """The same without room for weights (on the meta device), to know its sizes."""
    known = architecture is not None
    its = hub_config(architecture, config.name) if known else read_config(checkpoint_folder(config.name))
    with torch.device("meta"):
        return _encoder(empty_model(its), config, size)


def _encoder(hub: Any, config: HubEncoderConfig, size: tuple[int, int]) -> HubEncoder:
    kind = HubResNet if hub.config.model_type == "resnet" else HubVit
    return kind(hub, size=size, trained=config.trained_blocks, dim=config.dim)


def _blocks(hub: Any) -> nn.ModuleList:
    """The transformer blocks, wherever a family keeps them."""
    for holder in (hub, getattr(hub, "encoder", None), getattr(hub, "model", None)):
        for name in ("layers", "layer"):
            if isinstance(blocks := getattr(holder, name, None), nn.ModuleList):
                return blocks
    raise AttributeError(f"{type(hub).__name__}: no blocks")


def _norm(hub: Any) -> nn.Module:
    """The final norm."""
    norm: nn.Module = hub.norm if hasattr(hub, "norm") else hub.layernorm
    return norm


def _grid(config: Any) -> tuple[int, int]:
    """(rows, columns) that a model was trained with."""
    size = config.image_size
    height, width = (size, size) if isinstance(size, int) else size
    return height // config.patch_size, width // config.patch_size


def _interpolated(positions: Tensor, grid: tuple[int, int], wanted: tuple[int, int], smooth: bool) -> Tensor:
    """Position embeddings (1, 1 + rows * columns, D) of [CLS] and of a grid's patches for the grid `wanted`."""
    if grid == wanted:
        return positions.detach()
    image = positions.detach()[:, 1:].mT.unflatten(2, grid)
    image = functional.interpolate(image, wanted, mode="bicubic", antialias=smooth)
    return torch.cat([positions.detach()[:, :1], image.flatten(2).mT], dim=1)


def _freeze_statistics(module: nn.Module) -> None:
    for name, child in module.named_children():
        if isinstance(child, nn.BatchNorm2d):
            setattr(module, name, FrozenBatchNorm(child))
        else:
            _freeze_statistics(child)


def _kind(hub: Any) -> str:
    return str(hub.config.model_type)
