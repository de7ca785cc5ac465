"""The two stages of the fit: the space of garments (section 4.2), then the dynamics in it (section 5)."""

from __future__ import annotations

import math
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
_FRAMES_PER_NUMBER = 16  # of a latent code, that its beginning is taken from
_AT_ONCE = 16  # frames, in memory
_DISTINCT = 0.01  # of the largest singular value; what varies less is noise


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
        return _mean([(len(frames), self._static(clip, frames)) for clip, frames in self._draw(step, 0)])

    def dynamic(self, step: int) -> dict[str, Tensor]:
        """L_geo + L_Z + λ2 L_reg (equation 2) of frames after true ones, and of those that nothing moves."""
        drawn = self._draw(step, HISTORY)
        return _mean([(len(frames), self._dynamic(clip, frames)) for clip, frames in drawn])

    def _static(self, clip: TrainingClip, frames: Tensor) -> dict[str, Tensor]:
        config, model = self._config, self._model
        seeds, truth = clip.body.seeds[frames], clip.garment[frames]
        code = model.static_code(truth, seeds.points, clip.rest)
        decoded = model.decoded(code, clip.rest)
        garment, _ = posed(decoded.canonical, decoded.weights, seeds)
        imagined = model.canonical(torch.randn_like(code), clip.rest)
        both = torch.cat([decoded.canonical, imagined])
        # Two terms of means over one half each.
        clearance = 2 * losses.clearance_loss(clip.surface.distance(both), config.margin_m)
        return {
            "reconstruction": losses.reconstruction_loss(garment, truth, self._laplacian),
            "random": losses.edge_loss(imagined, clip.rest.vertices, self._edges),
            "clearance": config.collision * clearance,
            "regularisation": config.regularisation * losses.code_regularisation(code),
        }

    def _dynamic(self, clip: TrainingClip, frames: Tensor) -> dict[str, Tensor]:
        config, model = self._config, self._model
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

    def _draw(self, step: int, first: int) -> list[tuple[TrainingClip, Tensor]]:
        """Frames of a batch, of all clips' from `first` on, by clip."""
        generator = np.random.default_rng((self._seed, step, first))
        ends = np.cumsum([len(clip.garment) - first for clip in self._clips])
        drawn = np.sort(generator.permutation(ends[-1])[: self._config.batch_frames])
        owner = np.searchsorted(ends, drawn, side="right")
        parts = []
        for number in np.unique(owner):
            clip = self._clips[number]
            frames = drawn[owner == number] - ends[number] + len(clip.garment)
            parts.append((clip, torch.from_numpy(frames).to(clip.garment.device)))
        return parts


def _mean(parts: Sequence[tuple[int, dict[str, Tensor]]]) -> dict[str, Tensor]:
    """Terms of a batch from those of its parts, each a mean over so many frames."""
    total = sum(count for count, _ in parts)
    return {
        name: torch.stack([count / total * terms[name] for count, terms in parts]).sum()
        for name in parts[0][1]
    }


@torch.no_grad()
def begin_codes(model: MotionGuidedModel, clips: Sequence[TrainingClip]) -> None:
    """Let the latent codes of the training frames begin with mean 0, variance 1 and no correlation.

    Left to itself the encoder begins with codes that are nearly the same for all frames; L_reg is content with one
    code of the right length, and the decoder learns the mean garment for hundreds of steps. As many numbers as there
    are frames to tell apart begin this way (principal components of the last layer's inputs), the others at 0.
    """
    layer, taken = model.space.encoder.code, []
    for clip in clips:
        share = max(1, math.ceil(_FRAMES_PER_NUMBER * layer.out_features / len(clips)))
        chosen = np.unique(np.linspace(0, len(clip.garment) - 1, share).round().astype(int))
        for frames in torch.from_numpy(chosen).split(_AT_ONCE):
            features = model.static_features(clip.garment[frames], clip.body.seeds.points[frames], clip.rest)
            taken.append(model.space.encoder.layers(features).flatten(1))
    inputs = torch.cat(taken)
    mean = inputs.mean(0)
    _, sizes, directions = torch.linalg.svd(inputs - mean, full_matrices=False)
    known = min(layer.out_features, int((sizes > _DISTINCT * sizes[0]).sum()))
    weight = torch.zeros_like(layer.weight)
    weight[:known] = directions[:known] / sizes[:known, None] * len(inputs) ** 0.5
    layer.weight.copy_(weight)
    layer.bias.copy_(-weight @ mean)


def _placed(value: Any, device: torch.device) -> Any:
    """A tensor on a device, or a dataclass with all its tensors there."""
    if isinstance(value, Tensor):
        return value.to(device)
    if not is_dataclass(value) or isinstance(value, type):
        return value
    parts = {field.name: _placed(getattr(value, field.name), device) for field in fields(value)}
    return replace(value, **parts)
