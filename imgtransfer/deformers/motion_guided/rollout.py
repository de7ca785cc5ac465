"""A garment frame after frame, each from those before it (section 5)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.motion_guided.collisions import Surface, resolved
from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.model import Decoded, MotionGuidedModel
from imgtransfer.deformers.motion_guided.moving_body import MovingBody
from imgtransfer.deformers.motion_guided.skinning import Rest, kernel_weights, posed


class Rollout:
    """A garment on one moving body.

    Args:
        body: in all frames. rest: the garment at rest.
    """

    def __init__(
        self, config: MotionGuidedConfig, model: MotionGuidedModel, body: MovingBody, rest: Rest
    ) -> None:
        self.body, self.rest = body, rest
        self._config, self._model = config, model
        self._laplacian = graph_laplacian(model.faces.numpy(), len(model.maps.uvs))

    @torch.no_grad()
    def start(self) -> np.ndarray:
        """The garment (N, 3) in the world in which a roll-out begins, with nothing known but the body.

        The template skinned by its kernel weights is encoded and decoded, so that it is a garment of the space; then
        the body stands still for `warm_up_frames`.
        """
        model, rest, body = self._model, self.rest, self.body
        seeds, points = body.seeds[:1], rest.vertices[None]
        radius = model.space.log_radius.exp()[model.parts]
        skinned, _ = posed(points, kernel_weights(points, rest.seeds, radius), seeds)
        decoded = model.decoded(model.static_code(skinned, seeds.points, rest), rest)
        garment = self._placed(decoded, 0)
        history = [garment] * 3
        for _ in range(self._config.warm_up_frames):
            history = [self._next(0, 0, history), *history[:2]]
        return history[0]

    @torch.no_grad()
    def frames(self, history: Sequence[np.ndarray], first: int) -> Iterator[np.ndarray]:
        """The garments (N, 3) in the world of frames `first`, `first` + 1, ...

        Args:
            history: those of the three frames before, the last one first.
            first: at least 1.
        """
        known = list(history)
        for frame in range(first, len(self.body.vertices)):
            known = [self._next(frame, frame - 1, known), *known[:2]]
            yield known[0]

    def _next(self, frame: int, last: int, history: Sequence[np.ndarray]) -> np.ndarray:
        model, body = self._model, self.body
        before = body.before(frame, last, history)
        features = model.static_features(before.own_points, before.seeds, self.rest)
        seeds = body.seeds[frame : frame + 1]
        code = model.dynamics(features, model.motion_map(before, seeds))
        return self._placed(model.decoded(code, self.rest), frame)

    def _placed(self, decoded: Decoded, frame: int) -> np.ndarray:
        """A decoded garment on the body of a frame, without collisions, in the world."""
        body = self.body
        garment, turns = posed(decoded.canonical, decoded.weights, body.seeds[frame : frame + 1])
        surface = Surface(body.vertices[frame], body.normals[frame])
        axes = turns[0] @ self.rest.axes
        clear: Tensor = resolved(
            garment[0], axes, surface, maps=self._model.maps, laplacian=self._laplacian, config=self._config
        )
        return body.frames.part(slice(frame, frame + 1)).to_world(clear[None].numpy())[0]
