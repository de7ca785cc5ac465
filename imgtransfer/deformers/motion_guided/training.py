"""The two stages of the fit: the space of garments (section 4.2), then the dynamics in it (section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from fusion.obstacles.sdf import BodySdf
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.motion_guided import losses
from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.model import Before, MotionGuidedModel
from imgtransfer.deformers.motion_guided.moving_body import MovingBody, at_rest, moving_body
from imgtransfer.deformers.motion_guided.skinning import Rest, posed
from render.mesh.mesh import edges_of

HISTORY = 3  # frames before one, by which velocity and acceleration are known


@dataclass(frozen=True, eq=False)
class TrainingClip:
    """A clip to fit to.

    Args:
        body, rest: as their classes say. garment: (T, N, 3) float32 in the heading's axes.
        before: of frames `HISTORY` to T − 1, what each is told of the frames before it.
        surface: the body at rest.
    """

    body: MovingBody
    rest: Rest
    garment: Tensor
    before: Before
    surface: BodySdf


def training_clip(clip: Clip, chosen: np.ndarray, device: torch.device) -> TrainingClip:
    """Read a clip with the garment's motion and more than `HISTORY` frames.

    Args:
        chosen: (J,) body vertices, the seed points. device: where its tensors go.
    """
    assert clip.garment is not None
    body, truth = moving_body(clip, chosen), clip.garment.vertices
    told = [
        body.before(frame, frame - 1, [truth[frame - 1], truth[frame - 2], truth[frame - 3]])
        for frame in range(HISTORY, clip.n_frames)
    ]
    surface = BodySdf(clip.body.faces, len(clip.body.rest), device=device)
    surface.update(clip.body.rest)
    names = ("points", "velocity", "acceleration", "own_points", "seeds")
    before = Before(*(torch.cat([getattr(one, name) for one in told]) for name in names))
    garment = torch.from_numpy(body.frames.to_canonical(truth))
    return _placed(TrainingClip(body, at_rest(clip, chosen), garment, before, surface), device)


class Stages:
    """The losses of both stages, from the step's number alone.

    Args:
        clips: each with more than `HISTORY` frames. seed: of the batches.
    """

    def __init__(
        self,
        config: MotionGuidedConfig,
        model: MotionGuidedModel,
        clips: Sequence[TrainingClip],
        seed: int,
    ) -> None:
        self._config, self._model, self._clips, self._seed = config, model, clips, seed
        faces = model.faces.cpu().numpy()
        self._laplacian = graph_laplacian(faces, len(model.maps.uvs))
        self._edges = torch.from_numpy(edges_of(faces)).to(model.faces.device)

    def learning_rate(self, step: int) -> float:
        """Halved every `halve_steps`."""
        return self._config.learning_rate * 0.5 ** (step // self._config.halve_steps)

    def static(self, step: int) -> dict[str, Tensor]:
        """L_rec + L_rand + λ1 L_SDF0 + λ2 L_reg of garments as they are."""
        config, model = self._config, self._model
        clip, frames = self._draw(step, 0)
        seeds, truth = clip.body.seeds[frames], clip.garment[frames]
        code = model.static_code(truth, seeds.points, clip.rest)
        decoded = model.decoded(code, clip.rest)
        garment, _ = posed(decoded.canonical, decoded.weights, seeds)
        imagined = model.decoded(torch.randn_like(code), clip.rest).canonical
        both = torch.cat([decoded.canonical, imagined])
        # Two terms of means over one half each.
        clearance = 2 * losses.clearance_loss(clip.surface.distance(both), config.margin_m)
        return {
            "reconstruction": losses.reconstruction_loss(garment, truth, self._laplacian),
            "random": losses.edge_loss(imagined, clip.rest.vertices, self._edges),
            "clearance": config.collision * clearance,
            "regularisation": config.regularisation * losses.code_regularisation(code),
        }

    def dynamic(self, step: int) -> dict[str, Tensor]:
        """L_geo + L_Z + λ2 L_reg (equation 2) of frames after true ones, and of those that nothing moves."""
        config, model = self._config, self._model
        clip, frames = self._draw(step, HISTORY)
        seeds, last = clip.body.seeds[frames], clip.body.seeds[frames - 1]
        truth, truth_last = clip.garment[frames], clip.garment[frames - 1]
        index = frames - HISTORY
        before = clip.before
        before = Before(
            before.points[index],
            before.velocity[index],
            before.acceleration[index],
            before.own_points[index],
            before.seeds[index],
        )
        with torch.no_grad():
            features = model.static_features(truth_last, last.points, clip.rest)
            code_last = model.space.encoder(features)
            code_true = model.static_code(truth, seeds.points, clip.rest)
        code = model.dynamics(features, model.motion_map(before, seeds))
        still = model.dynamics(features, None)
        garment = model.garment(code, clip.rest, seeds)
        garment_last = model.garment(still, clip.rest, last)
        regularisation = losses.code_regularisation(code) + losses.code_regularisation(still)
        return {
            "geometry": losses.geometry_loss(garment, truth) + losses.geometry_loss(garment_last, truth_last),
            "code": losses.code_loss(code, code_true) + losses.code_loss(still, code_last),
            "regularisation": config.regularisation * regularisation,
        }

    def _draw(self, step: int, first: int) -> tuple[TrainingClip, Tensor]:
        """A clip, by its number of frames, and frames of it from `first` on."""
        generator = np.random.default_rng((self._seed, step, first))
        counts = np.array([len(clip.garment) - first for clip in self._clips])
        clip = self._clips[generator.choice(len(counts), p=counts / counts.sum())]
        available = len(clip.garment) - first
        frames = generator.permutation(available)[: self._config.batch_frames] + first
        return clip, torch.from_numpy(np.sort(frames)).to(clip.garment.device)


def _placed(value: Any, device: torch.device) -> Any:
    """A tensor on a device, or a dataclass with all its tensors there."""
    if isinstance(value, Tensor):
        return value.to(device)
    if not is_dataclass(value) or isinstance(value, type):
        return value
    parts = {field.name: _placed(getattr(value, field.name), device) for field in fields(value)}
    return replace(value, **parts)
