"""The networks of figure 3: S, E_sta, D and R of the space of garments, C and E_dyn of the dynamics."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig

DISPLACEMENT_M = 0.02  # what an output of 1 means
_SLOPE = 0.2  # of LeakyReLU
_PERCEPTRON = 6  # layers of R
_STATIC, _MOTION = 4, 6  # layers of S and of C


class GarmentSpace(nn.Module):
    """The regularised autoencoder (section 4.2): descriptors to a latent code, and that to displacements.

    Args:
        seeds: J. parts: of the body. radius: at first, metres.
    """

    def __init__(self, config: MotionGuidedConfig, *, seeds: int, parts: int, radius: float) -> None:
        super().__init__()
        features = config.features
        self.project = flat_layers(3 * seeds, features, _STATIC)
        self.encoder = Encoder(features, config)
        self.decoder = Decoder(config)
        layers: list[nn.Module] = []
        width = features + 2
        for _ in range(_PERCEPTRON - 1):
            layers += [nn.Linear(width, features), nn.LeakyReLU(_SLOPE)]
            width = features
        last = nn.Linear(width, 3)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.perceptron = nn.Sequential(*layers, last)
        self.log_radius = nn.Parameter(torch.full((parts,), radius).log())

    def displacements(self, features: Tensor, uvs: Tensor) -> Tensor:
        """R: features (B, N, features) read at vertices with their coordinates (N, 2) -> d (B, N, 3), metres."""
        both = torch.cat([features, uvs.expand(len(features), -1, -1)], -1)
        return DISPLACEMENT_M * self.perceptron(both)


class Dynamics(nn.Module):
    """C and the dynamic encoder E_dyn (section 5).

    Args:
        seeds: J.
    """

    def __init__(self, config: MotionGuidedConfig, *, seeds: int) -> None:
        super().__init__()
        self.motion = flat_layers(3 * seeds + 6, config.features, _MOTION)
        self.encoder = Encoder(2 * config.features, config)

    def forward(self, static: Tensor, motion: Tensor | None) -> Tensor:
        """Z_t of S(M_P) (B, features, size, size) and the maps of C_t, velocity and acceleration; E_t = 0 for None."""
        encoded = torch.zeros_like(static) if motion is None else self.motion(motion)
        return self.encoder(torch.cat([static, encoded], 1))


class Encoder(nn.Module):
    """Convolutions that each halve the map, with instance normalisation, then a linear layer to the latent code."""

    def __init__(self, channels: int, config: MotionGuidedConfig) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for width in config.channels:
            layers += [
                nn.Conv2d(channels, width, 3, stride=2, padding=1),
                nn.InstanceNorm2d(width, affine=True),
                nn.LeakyReLU(_SLOPE),
            ]
            channels = width
        self.layers = nn.Sequential(*layers)
        self.code = nn.Linear(4 * channels, config.latent)

    def forward(self, image: Tensor) -> Tensor:
        """(B, channels, size, size) -> (B, latent)."""
        return self.code(self.layers(image).flatten(1))


class Decoder(nn.Module):
    """The encoder the other way round, and one layer more, to maps of twice the size."""

    def __init__(self, config: MotionGuidedConfig) -> None:
        super().__init__()
        widths = [*config.channels[::-1], config.features, config.features]
        self.first = nn.Linear(config.latent, 4 * widths[0])
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [
                nn.ConvTranspose2d(before, after, 4, stride=2, padding=1),
                nn.InstanceNorm2d(after, affine=True),
                nn.LeakyReLU(_SLOPE),
            ]
        self.layers = nn.Sequential(*layers)

    def forward(self, code: Tensor) -> Tensor:
        """(B, latent) -> (B, features, 2 size, 2 size)."""
        return self.layers(self.first(code).unflatten(1, (-1, 2, 2)))


def flat_layers(channels: int, features: int, count: int) -> nn.Sequential:
    """Convolutions that keep the size. Not normalised, or how fast a whole garment moves would be lost."""
    layers: list[nn.Module] = []
    for _ in range(count):
        layers += [nn.Conv2d(channels, features, 3, padding=1), nn.LeakyReLU(_SLOPE)]
        channels = features
    return nn.Sequential(*layers)
