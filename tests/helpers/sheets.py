"""A flat square of cloth seen from the front, and its position maps: what pixels say is easy to tell by hand."""

import numpy as np
import torch

from render import Mesh, TemplateImager

SIDE = 0.4  # metres


def sheet(cells: int = 24, side: float = SIDE) -> Mesh:
    """(cells + 1)² vertices around the origin at z = 0, facing +z."""
    line = np.linspace(-side / 2, side / 2, cells + 1)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
    row, column = (part.ravel() for part in np.mgrid[:cells, :cells])
    a = row * (cells + 1) + column
    faces = np.concatenate(
        [np.stack([a, a + 1, a + cells + 2], 1), np.stack([a, a + cells + 2, a + cells + 1], 1)]
    )
    return Mesh(vertices, faces)


def sheet_imager(mesh: Mesh | None = None, size: tuple[int, int] = (24, 28)) -> TemplateImager:
    """From the front only."""
    return TemplateImager.build(mesh or sheet(), views=("front",), size=size, backend="numpy")


def own_maps(imager: TemplateImager, frames: int = 1) -> torch.Tensor:
    """(frames, S, H, W, 3) float32: the template's own position maps."""
    vertices = torch.from_numpy(imager.mesh.vertices).float()
    return imager.operator(vertices).expand(frames, -1, -1, -1, -1).clone()
