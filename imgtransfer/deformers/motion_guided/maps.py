"""What the networks see: maps in the garment's texture space of where it is to the body, how it moves, what pushes it.

Points are in a frame that turns with the body's heading, so that results turn with a clip. B frames, J seed points, P
pixels that the garment covers, N vertices.
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn import functional

# What an input of 1 means, so that all are of one order: of descriptors less those at rest, forces, and accelerations
# beside velocities in m/s.
DESCRIPTOR_M, FORCE_M, ACCELERATION = 0.1, 0.01, 10.0


class TextureMaps(nn.Module):
    """Values at vertices to maps, and maps to vertices.

    Args:
        size: of the maps, pixels a side. uvs, pixels, corners, weights: as `TextureSpace`.
    """

    uvs: Tensor
    pixels: Tensor
    corners: Tensor
    weights: Tensor

    def __init__(self, size: int, uvs: Tensor, pixels: Tensor, corners: Tensor, weights: Tensor) -> None:
        super().__init__()
        self.size = size
        for name, value in (("uvs", uvs), ("pixels", pixels), ("corners", corners), ("weights", weights)):
            self.register_buffer(name, value)

    def at_pixels(self, values: Tensor) -> Tensor:
        """(B, N, C) -> (B, P, C)."""
        return (values[:, self.corners] * self.weights[..., None]).sum(2)

    def image(self, values: Tensor) -> Tensor:
        """(B, P, C) -> (B, C, size, size), 0 where there is no garment."""
        image = values.new_zeros(len(values), values.shape[2], self.size * self.size)
        image[:, :, self.pixels] = values.mT
        return image.unflatten(-1, (self.size, self.size))

    def covered(self) -> Tensor:
        """(1, 1, size, size): 1 where there is garment, else 0."""
        return self.image(self.weights.new_ones(1, len(self.pixels), 1))

    def at_vertices(self, image: Tensor) -> Tensor:
        """(B, C, H, W) of any size -> (B, N, C), bilinear."""
        grid = (2 * self.uvs - 1).expand(len(image), 1, -1, -1)
        read = functional.grid_sample(image, grid, align_corners=False, padding_mode="border")
        return read[:, :, 0].mT


def interaction_forces(
    points: Tensor, seeds: Tensor, normals: Tensor, distance: Tensor, sigma: float
) -> Tensor:
    """C_t, how the body as it is now pushes the garment as it was (section 5).

    Args:
        points: (B, P, 3) of the last frame. seeds, normals: (B, J, 3) of this frame.
        distance: (B, P, J) of the points to the seed points of the last frame, metres.
        sigma: metres.

    Returns:
        (B, P, 3 J): f = exp(−‖g − b‖² / 2σ²) max(−q, 0) n with q = (g_(t−1) − b_t) · n, metres.
    """
    along = points @ normals.mT - (seeds * normals).sum(-1)[:, None]  # q (B, P, J)
    strength = (-distance.square() / (2 * sigma**2)).exp() * (-along).relu()
    return (strength[..., None] * normals[:, None]).flatten(2)
