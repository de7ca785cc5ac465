"""Networks on the vertices of a garment: PointNet (Qi et al. 2017), and a graph network (Xu et al. 2018)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from render.mesh.sparse import SparseProduct

INPUTS = 12  # of a vertex: template and its normal, how far the nearest body vertex is off it, and that one's normal
BODY_INPUTS = 6  # of a body point: position and normal


class VertexNetwork(nn.Module):
    """Positions of vertices from what is told of each, and from a code of the whole body.

    Args:
        features: width.
        blocks: layers of the graph network.
        laplacian: (N, N) of the garment's edges (`graph_laplacian`) for the graph network; None is PointNet.
    """

    def __init__(self, features: int, blocks: int, laplacian: SparseProduct | None) -> None:
        super().__init__()
        self.laplacian = laplacian
        self.body = _perceptron(BODY_INPUTS, features, features)
        self.points = _perceptron(INPUTS, features, features)
        layers = blocks if laplacian is not None else 0
        self.layers = nn.ModuleList(_perceptron(features, features, features) for _ in range(layers))
        self.own = nn.Parameter(torch.zeros(layers))  # epsilon of equation 4.1 there
        codes = 2 if laplacian is None else 1  # PointNet has one of the garment beside the body's
        self.out = _perceptron((1 + codes) * features, features, 3)
        for weight in self.out[-1].parameters():  # begins with the template
            nn.init.zeros_(weight)

    def forward(self, vertices: Tensor, body: Tensor) -> Tensor:
        """(B, N, 12) of vertices and (B, P, 6) of body points -> (B, N, 3), metres, offsets from the template."""
        codes = [self.body(body).amax(1)]
        told = self.points(vertices)
        if self.laplacian is None:
            codes.append(told.amax(1))
        for layer, own in zip(self.layers, self.own, strict=True):
            around = told - self.laplacian(told)  # type: ignore[misc]  # the mean of each vertex's neighbours
            told = told + layer((1 + own) * told + around)
        seen = torch.cat(codes, dim=-1)[:, None].expand(-1, told.shape[1], -1)
        offsets: Tensor = self.out(torch.cat([told, seen], dim=-1))
        return offsets


def _perceptron(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inputs, hidden), nn.SiLU(), nn.Linear(hidden, outputs))
