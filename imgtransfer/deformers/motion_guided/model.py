"""All that a fit makes: networks, texture space, seed points; and the ways from garments to codes and back."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.maps import (
    ACCELERATION,
    DESCRIPTOR_M,
    FORCE_M,
    TextureMaps,
    interaction_forces,
)
from imgtransfer.deformers.motion_guided.networks import Dynamics, GarmentSpace
from imgtransfer.deformers.motion_guided.skinning import Rest, Seeds, kernel_weights, posed


@dataclass(frozen=True, eq=False)
class Before:
    """The garment in the last frame, as this frame's body and heading see it; B frames.

    Args:
        points: (B, N, 3) in this frame's axes. velocity, acceleration: (B, N, 3) in the same, m/s and m/s².
        own_points: (B, N, 3) in the last frame's axes. seeds: (B, J, 3) of the last frame in those.
    """

    points: Tensor
    velocity: Tensor
    acceleration: Tensor
    own_points: Tensor
    seeds: Tensor


@dataclass(frozen=True, eq=False)
class Decoded:
    """A garment decoded from latent codes.

    Args:
        canonical: (B, N, 3) ĝ. weights: (B, N, J).
    """

    canonical: Tensor
    weights: Tensor


class MotionGuidedModel(nn.Module):
    """The space of garments, the dynamics and what they are laid out on.

    Args:
        seeds: (J,) int64, body vertices. parts: (J,) int64 of the body. radius: of all parts at first, metres.
        faces: (F, 3) int64 of the garment. fps: of the clips fitted to. body_vertices: B.
    """

    seeds: Tensor
    parts: Tensor
    faces: Tensor
    fps: Tensor
    body_vertices: Tensor

    def __init__(
        self,
        config: MotionGuidedConfig,
        maps: TextureMaps,
        *,
        seeds: Tensor,
        parts: Tensor,
        radius: float,
        faces: Tensor,
        fps: float,
        body_vertices: int,
    ) -> None:
        super().__init__()
        self.maps = maps
        self.interaction_m = config.interaction_m
        count = int(parts.max()) + 1
        self.space = GarmentSpace(config, seeds=len(seeds), parts=count, radius=radius)
        self.dynamics = Dynamics(config, seeds=len(seeds))
        self.register_buffer("seeds", seeds)
        self.register_buffer("parts", parts)
        self.register_buffer("faces", faces)
        self.register_buffer("fps", torch.tensor(fps, dtype=torch.float64))
        self.register_buffer("body_vertices", torch.tensor(body_vertices))

    def static_features(self, points: Tensor, seeds: Tensor, rest: Rest) -> Tensor:
        """S(M_P) of garments (B, N, 3) around seed points (B, J, 3), as differences from the descriptor at rest."""
        moved = self.maps.image(self.maps.at_pixels(points - rest.vertices) / DESCRIPTOR_M)
        return self.space.features(moved, self.maps.covered(), (seeds - rest.seeds) / DESCRIPTOR_M)

    def static_code(self, points: Tensor, seeds: Tensor, rest: Rest) -> Tensor:
        """Z (B, latent) by E_sta."""
        return self.space.encoder(self.static_features(points, seeds, rest))

    def motion_map(self, before: Before, seeds: Seeds) -> Tensor:
        """C_t, velocity and acceleration as one map (B, 3 J + 6, size, size)."""
        own, points = self.maps.at_pixels(before.own_points), self.maps.at_pixels(before.points)
        distance = torch.cdist(own, before.seeds)
        forces = interaction_forces(points, seeds.points, seeds.normals, distance, self.interaction_m)
        moving = torch.cat([before.velocity, before.acceleration / ACCELERATION], -1)
        return self.maps.image(torch.cat([forces / FORCE_M, self.maps.at_pixels(moving)], -1))

    def canonical(self, code: Tensor, rest: Rest) -> Tensor:
        """ĝ (B, N, 3) of codes (B, latent)."""
        features = self.maps.at_vertices(self.space.decoder(code))
        return rest.displaced(self.space.displacements(features, self.maps.uvs))

    def decoded(self, code: Tensor, rest: Rest) -> Decoded:
        """Displacements and kernel weights of codes (B, latent)."""
        canonical = self.canonical(code, rest)
        radius = self.space.log_radius.exp()[self.parts]
        return Decoded(canonical, kernel_weights(canonical, rest.seeds, radius))

    def garment(self, code: Tensor, rest: Rest, seeds: Seeds) -> Tensor:
        """(B, N, 3) of codes (B, latent) on bodies in B frames."""
        decoded = self.decoded(code, rest)
        return posed(decoded.canonical, decoded.weights, seeds)[0]
