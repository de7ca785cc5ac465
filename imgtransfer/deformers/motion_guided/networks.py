"""The networks of figure 3: S, E_sta, D and R of the space of garments, C and E_dyn of the dynamics."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

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
        self.perceptron = perceptron(features + 2, features)
        self.log_radius = nn.Parameter(torch.full((parts,), radius).log())

    def features(self, moved: Tensor, covered: Tensor, shifts: Tensor) -> Tensor:
        """S(M_P), of descriptors that are differences from those at rest.

        The map of 3 J channels is not made: what it has at a point for each seed point is how far the point moved less
        how far that one did, so the first convolution is one of three channels, and one of the garment's outline.

        Args:
            moved: (B, 3, size, size) of the points, 0 where there is no garment. covered: (1, 1, size, size), 1 where
                there is. shifts: (B, J, 3) of the seed points, all in the unit of the descriptors.

        Returns:
            (B, features, size, size).
        """
        first = self.project[0]
        assert isinstance(first, nn.Conv2d)
        weight = first.weight.unflatten(1, (-1, 3))  # (features, J, 3, 3, 3)
        of_points = functional.conv2d(moved, weight.sum(1), first.bias, padding=1)
        of_seeds = torch.einsum("bjc,fjchw->bfhw", shifts, weight).flatten(2)
        outline = functional.unfold(covered, 3, padding=1)[0]  # (9, size²)
        return self.project[1:](of_points - (of_seeds @ outline).view_as(of_points))

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

    @torch.no_grad()
    def begin_still(self, encoder: Encoder) -> None:
        """Let E_dyn begin as E_sta, blind to motion: the last frame's code, which it must say where E_t = 0."""
        ours, theirs = self.encoder.layers[0], encoder.layers[0]
        assert isinstance(ours, nn.Conv2d)
        assert isinstance(theirs, nn.Conv2d)
        first, static = ours.weight, theirs.weight
        own = {key: value for key, value in encoder.state_dict().items() if key != "layers.0.weight"}
        padded = torch.cat([static, torch.zeros_like(first[:, static.shape[1] :])], 1)
        self.encoder.load_state_dict(own | {"layers.0.weight": padded})

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


def perceptron(inputs: int, width: int) -> nn.Sequential:
    """R, whose output of three numbers is 0 at first: the template.

    Its layers keep the size of what goes through them (He et al. 2015). PyTorch's own beginning makes it a hundred
    times smaller over the five of them, and what the code says hardly reached the displacements.
    """
    layers: list[nn.Module] = []
    for _ in range(_PERCEPTRON - 1):
        layer = nn.Linear(inputs, width)
        nn.init.kaiming_normal_(layer.weight, a=_SLOPE)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.LeakyReLU(_SLOPE)]
        inputs = width
    last = nn.Linear(inputs, 3)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*layers, last)


def flat_layers(channels: int, features: int, count: int) -> nn.Sequential:
    """Convolutions that keep the size. Not normalised, or how fast a whole garment moves would be lost."""
    layers: list[nn.Module] = []
    for _ in range(count):
        layers += [nn.Conv2d(channels, features, 3, padding=1), nn.LeakyReLU(_SLOPE)]
        channels = features
    return nn.Sequential(*layers)
