"""The high-frequency stage: displacements of vertices from the bones' motion and from the mesh that they give."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.deformers.common.recurrent import MotionGru

_SLOPE = 0.2  # of the activation below 0; above 0, so that it keeps the order of numbers


class Displacements(nn.Module):
    """Pan et al. 2022: global information of the bones' motions, and local information of the low-frequency mesh.

    A recurrent unit reads the numbers of all bones and gives each vertex some features; convolutions over edges read
    the low-frequency mesh; a linear layer makes a displacement of both, in the root's frame.

    Args:
        numbers: (S, 6 V) of the bones in the training.
        residuals: (S', N, 3) metres, that the low-frequency stage leaves in some frames of the training.
        neighbours: (N, D), see `neighbours_of`. edge_length: mean of the template's edges, metres.
        hidden, dropout, vertex_features, edge_features: see `VirtualBonesConfig`.
    """

    mean: Tensor
    scale: Tensor
    neighbours: Tensor
    edge_length: Tensor

    def __init__(
        self,
        numbers: Tensor,
        residuals: Tensor,
        neighbours: Tensor,
        edge_length: float,
        *,
        hidden: int,
        dropout: float,
        vertex_features: int,
        edge_features: tuple[int, ...],
    ) -> None:
        super().__init__()
        mean = residuals.mean(0)
        self.register_buffer("mean", mean)
        self.register_buffer("scale", (residuals - mean).square().mean().sqrt().clamp(min=1e-5))
        self.register_buffer("neighbours", neighbours)
        self.register_buffer("edge_length", torch.tensor(edge_length))
        self.memory = MotionGru(numbers, hidden, dropout)
        self.to_vertices = nn.Linear(hidden, vertex_features * len(neighbours))
        widths = (3, *edge_features)
        self.convolutions = nn.ModuleList(
            EdgeConvolution(first, second) for first, second in zip(widths, edge_features, strict=False)
        )
        self.head = nn.Linear(vertex_features + widths[-1], 3)

    def forward(self, memory: Tensor, mesh: Tensor, template: Tensor) -> Tensor:
        """Displacements (F, N, 3), metres.

        Args:
            memory: (F, H) of the bones' motion. mesh: (F, N, 3) low-frequency vertices. template: (N, 3) or (F, N, 3).
        """
        features = nn.functional.leaky_relu(self.to_vertices(memory), _SLOPE).unflatten(
            -1, (len(self.mean), -1)
        )
        local = (mesh - template) / self.edge_length  # how far each vertex went, in edges
        for convolution in self.convolutions:
            local = convolution(local, self.neighbours)
        return self.mean + self.scale * self.head(torch.cat([features, local], -1))


class EdgeConvolution(nn.Module):
    """EdgeConv (Wang et al. 2019): x'_i = max over neighbours j of s(W (x_i, x_j - x_i) + b), s a leaky ReLU.

    W (x_i, x_j - x_i) is (U - V) x_i + V x_j, and s keeps the order of numbers, so that the maximum is taken of V x_j
    alone: the same numbers with a product a vertex in place of one an edge.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.own = nn.Linear(inputs, outputs)  # U and b
        self.other = nn.Linear(inputs, outputs, bias=False)  # V

    def forward(self, values: Tensor, neighbours: Tensor) -> Tensor:
        """(F, N, C) -> (F, N, C'); neighbours (N, D) int64."""
        other = self.other(values)
        greatest = other[:, neighbours].amax(-2)
        return nn.functional.leaky_relu(self.own(values) - other + greatest, _SLOPE)


def neighbours_of(edges: np.ndarray, count: int) -> Tensor:
    """(N, D) int64 neighbours of each vertex; where it has fewer than D its last one again, or itself.

    Args:
        edges: (E, 2), each once. count: N.
    """
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    degree = np.bincount(both[:, 0], minlength=count)
    first = np.cumsum(degree) - degree
    table = np.repeat(np.arange(count)[:, None], max(int(degree.max(initial=0)), 1), axis=1)
    for place in range(table.shape[1]):
        some = np.flatnonzero(degree)
        table[some, place] = both[first[some] + np.minimum(place, degree[some] - 1), 1]
    return torch.from_numpy(table)
