"""AnchorDEF's network: from the body's motion to the anchors' transformations, and from them to vertices.

Everything is in the canonical frame of the body's root, in which R_global is the identity and the root joint rests.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from imgtransfer.deformers.anchordef.config import AnchorDefConfig
from imgtransfer.deformers.common.recurrent import Standardise

TRANSLATION_M, DISPLACEMENT_M = 0.1, 0.02  # what an output of 1 means, so that all outputs are of one order


@dataclass(frozen=True)
class Sizes:
    """What tensors depend on beside the configuration: vertices N, faces, anchors, N' and K."""

    vertices: int
    faces: int
    anchors: int
    anchors_of_vertex: int
    vertices_of_anchor: int


@dataclass(frozen=True, eq=False)
class Outputs:
    """What the network says of frames.

    Args:
        angles: (..., A, 3) Euler angles of R_n about x, y, z, radians.
        shifts: (..., A, 3) metres, how far an anchor is moved.
        displacements: (..., N, 3) D of equation 5, metres.
    """

    angles: Tensor
    shifts: Tensor
    displacements: Tensor


class AnchorNetwork(nn.Module):
    """The body motion encoder with both MLPs (figure 10), and what it learns of the template: blend weights, places.

    The features are standardised by those of the training, beyond which the paper's raw pose and place would lead it.

    Args:
        features: (S, C) of all training frames.

    Buffers, set by the fit: `faces` (F, 3) of the garment, `fps` (), `neighbours` (A, K) vertices of each anchor,
    `anchors_near` (N, N') anchors of each vertex, `tight` (A,) bool.
    """

    neighbours: Tensor
    anchors_near: Tensor
    tight: Tensor
    fps: Tensor
    faces: Tensor

    def __init__(self, config: AnchorDefConfig, sizes: Sizes, features: Tensor) -> None:
        super().__init__()
        self._initial_state_std = config.initial_state_std
        self._anchors = sizes.anchors
        width = config.width
        self.standardise = Standardise(features)
        self.gru = nn.GRU(features.shape[1], width, config.layers, batch_first=True)
        self.transformations = _mlp(width, sizes.anchors * 6)
        self.displacements = _mlp(width, sizes.vertices * 3)
        self.alpha = nn.Parameter(torch.zeros(sizes.anchors, sizes.vertices_of_anchor))
        self.logits = nn.Parameter(torch.zeros(sizes.vertices, sizes.anchors))
        self.register_buffer("faces", torch.zeros(sizes.faces, 3, dtype=torch.int64))
        self.register_buffer("fps", torch.zeros((), dtype=torch.float64))
        self.register_buffer(
            "neighbours", torch.zeros(sizes.anchors, sizes.vertices_of_anchor, dtype=torch.int64)
        )
        self.register_buffer(
            "anchors_near", torch.zeros(sizes.vertices, sizes.anchors_of_vertex, dtype=torch.int64)
        )
        self.register_buffer("tight", torch.zeros(sizes.anchors, dtype=torch.bool))

    def forward(self, features: Tensor) -> Outputs:
        """(B, L, features) of the body's motion -> what each frame's garment is made by.

        The recurrent state begins at random in training, and at 0 otherwise (supplement A).
        """
        state = None
        if self.training and self._initial_state_std:
            shape = (self.gru.num_layers, len(features), self.gru.hidden_size)
            state = self._initial_state_std * torch.randn(shape, device=features.device)
        encoded, _ = self.gru(self.standardise(features), state)
        transformations = self.transformations(encoded).unflatten(-1, (self._anchors, 6))
        displacements = self.displacements(encoded).unflatten(-1, (-1, 3))
        return Outputs(
            transformations[..., :3],
            TRANSLATION_M * transformations[..., 3:],
            DISPLACEMENT_M * displacements,
        )

    def attention(self) -> Tensor:
        """(A, N): row n has the softmax of α of anchor n on its K vertices (equation 13), 0 elsewhere."""
        attention = self.alpha.new_zeros(self.logits.shape[::-1])
        return attention.scatter(1, self.neighbours, self.alpha.softmax(1))

    def blend_weights(self) -> Tensor:
        """(N, A): w of equation 2, not negative, rows of sum 1, 0 but for each vertex's N' nearest anchors."""
        weights = self.logits.gather(1, self.anchors_near).softmax(1)
        return torch.zeros_like(self.logits).scatter(1, self.anchors_near, weights)


def anchor_transformations(
    outputs: Outputs, anchors: Tensor, tight: Tensor, body_rotation: Tensor, body_translation: Tensor
) -> tuple[Tensor, Tensor]:
    """R and T of each anchor, rest to canonical frame (equations 3 and 4).

    The network turns an anchor about its own place p and moves it by s: R_n x + T_n with T_n = p + s - R_n p, all the
    transformations that R_n and T_n can be, but without the lever from the origin. In the canonical frame those are the
    loose ones: equation 3 takes the root's motion R_global x + J_root after them, and so does `RootFrames.to_world`.

    Args:
        anchors: (A, 3) p at rest.
        tight: (A,) bool.
        body_rotation: (..., A, 3, 3) R_body of each anchor's body vertex. body_translation: (..., A, 3) T_body.

    Returns:
        (..., A, 3, 3) and (..., A, 3).
    """
    rotation = euler_rotation(outputs.angles)
    translation = anchors + outputs.shifts - (rotation @ anchors[..., None])[..., 0]
    with_body = body_rotation @ rotation
    moved = (body_rotation @ translation[..., None])[..., 0] + body_translation
    return (
        torch.where(tight[:, None, None], with_body, rotation),
        torch.where(tight[:, None], moved, translation),
    )


def deformed(points: Tensor, weights: Tensor, rotation: Tensor, translation: Tensor) -> Tensor:
    """Linear blend skinning by anchors (equations 2 and 5).

    Args:
        points: (..., N, 3), the template with its displacements, v^c.
        weights: (N, A).
        rotation: (..., A, 3, 3). translation: (..., A, 3).

    Returns:
        (..., N, 3).
    """
    transforms = torch.cat([rotation, translation[..., None]], -1).flatten(-2)  # (..., A, 12)
    blended = (weights @ transforms).unflatten(-1, (3, 4))
    return (blended[..., :3] @ points[..., None])[..., 0] + blended[..., 3]


def euler_rotation(angles: Tensor) -> Tensor:
    """Angles (..., 3) about x, y, z, radians -> (..., 3, 3), R = R_z R_y R_x."""
    (sx, sy, sz), (cx, cy, cz) = angles.sin().unbind(-1), angles.cos().unbind(-1)
    rows = [
        *(cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx),
        *(sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx),
        *(-sy, cy * sx, cy * cx),
    ]
    return torch.stack(rows, -1).unflatten(-1, (3, 3))


def _mlp(width: int, outputs: int) -> nn.Sequential:
    """Two layers with a PReLU between (figure 10); the last begins at 0, so that anchors first move with the body."""
    last = nn.Linear(width, outputs)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(width, width), nn.PReLU(), last)
