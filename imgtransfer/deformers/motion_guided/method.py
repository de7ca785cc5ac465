"""The deformer `motion_guided`: fitted to clips, asked for clips, stored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder, check_faces, same_garment
from imgtransfer.deformers.common.rates import at_frames, same_rate
from imgtransfer.deformers.descent import descend
from imgtransfer.deformers.motion_guided.config import MotionGuidedConfig
from imgtransfer.deformers.motion_guided.maps import TextureMaps
from imgtransfer.deformers.motion_guided.model import MotionGuidedModel
from imgtransfer.deformers.motion_guided.moving_body import at_rest, moving_body
from imgtransfer.deformers.motion_guided.rollout import Rollout
from imgtransfer.deformers.motion_guided.seeds import body_parts, farthest_points, spacing
from imgtransfer.deformers.motion_guided.texture_space import texture_space
from imgtransfer.deformers.motion_guided.training import HISTORY, Stages, begin_codes, training_clip
from render import InputError

_REACH = 1.5  # of the kernel radius at first, in spacings of the seed points


class MotionGuided(Deformer):
    """Motion guided deep dynamic garments (Zhang et al. 2022): a garment's frame from those before it and from
    how the body pushes it, as a code in a space of garments.

    Of the body it reads the mesh alone, and joints but for the parts that share a kernel radius; so a garment
    beneath another can be its body (`layers.on_garment`).
    """

    name: ClassVar[str] = "motion_guided"
    Config = MotionGuidedConfig
    config: MotionGuidedConfig
    model: MotionGuidedModel

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        first = same_garment(clips)
        _check(clips)
        torch.manual_seed(folder.seed)
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.model = model = _begin(first, self.config).to(device)
        chosen = model.seeds.cpu().numpy()
        read = [training_clip(clip, chosen, device) for clip in clips]
        begin_codes(model, read)
        stages = Stages(self.config, model, read, folder.seed)
        descend(
            model.space,
            stages.static,
            stage="motion_guided_static",
            steps=self.config.static_steps,
            learning_rate=stages.learning_rate,
            folder=folder,
        )
        model.space.requires_grad_(False)
        model.dynamics.begin_still(model.space.encoder)
        descend(
            model.dynamics,
            stages.dynamic,
            stage="motion_guided_dynamic",
            steps=self.config.dynamic_steps,
            learning_rate=stages.learning_rate,
            folder=folder,
        )
        model.eval().cpu()  # a roll-out is one small frame after the other

    def predict(self, clip: Clip) -> np.ndarray:
        rollout, resampled = self.rollout(clip), self._other_rate(clip)
        start = rollout.start()
        garments = np.stack([start, *rollout.frames([start] * HISTORY, 1)])
        if resampled is None:
            return garments
        headings = rollout.body.frames
        canonical = at_frames(headings.to_canonical(garments), clip.n_frames, clip.fps, resampled)
        return root_frames(clip, "heading").to_world(canonical)

    def rollout(self, clip: Clip) -> Rollout:
        """The garment on a clip's body, at the rate of the fit.

        Raises:
            InputError: another garment, or a body of other vertices.
        """
        model = self.model
        check_faces(clip, model.faces.numpy())
        if len(clip.body.rest) != int(model.body_vertices):
            raise InputError(
                f"{clip.name}: a body of {len(clip.body.rest)} vertices, and the method was fitted to one of "
                f"{int(model.body_vertices)}, whose vertices it knows by number; give clips with the same body mesh"
            )
        chosen = model.seeds.numpy()
        body = moving_body(clip, chosen, self._other_rate(clip))
        return Rollout(self.config, model, body, at_rest(clip, chosen))

    def tensors(self) -> dict[str, Tensor]:
        return dict(self.model.state_dict())

    def restore(self, tensors: dict[str, Tensor]) -> None:
        try:
            model = _empty(self.config, tensors)
            model.load_state_dict(tensors, strict=True)
        except (KeyError, IndexError, RuntimeError) as error:
            raise ValueError(f"not what motion_guided with these settings has: {error}") from error
        _check_indices(model)
        self.model = model.eval()

    def parameters(self) -> int:
        return sum(value.numel() for value in self.model.parameters())

    def _other_rate(self, clip: Clip) -> float | None:
        """The rate of the fit, where a clip has another."""
        fps = self.model.fps.item()
        return None if same_rate(clip.fps, fps) else fps


def _check(clips: Sequence[Clip]) -> None:
    first = clips[0]
    for clip in clips:
        if clip.n_frames <= HISTORY:
            raise InputError(
                f"{clip.name}: {clip.n_frames} frames; motion_guided is fitted to clips of {HISTORY + 1} or more, from "
                "whose frames it knows velocity and acceleration; choose others with data.train.names"
            )
        if not same_rate(clip.fps, first.fps):
            raise InputError(
                f"{clip.name}: {clip.fps:g} frames a second, and {first.name} has {first.fps:g}; motion_guided is "
                "fitted to clips of one rate (it predicts for others), choose clips with data.train.names"
            )
        if not np.array_equal(clip.body.faces, first.body.faces):
            raise InputError(
                f"{clip.name}: another body mesh ({len(clip.body.rest)} vertices) than that of {first.name} "
                f"({len(first.body.rest)}); motion_guided is fitted to one, choose clips with data.train.names"
            )


def _begin(clip: Clip, config: MotionGuidedConfig) -> MotionGuidedModel:
    chosen = farthest_points(clip.body.rest, clip.body.faces, config.seeds)
    space = texture_space(clip.template, config.uv_size)
    maps = TextureMaps(
        config.uv_size,
        *(torch.from_numpy(value) for value in (space.uvs, space.pixels, space.corners, space.weights)),
    )
    return MotionGuidedModel(
        config,
        maps,
        seeds=torch.from_numpy(chosen),
        parts=torch.from_numpy(body_parts(clip, chosen)),
        radius=_REACH * spacing(clip.body.rest[chosen]),
        faces=torch.from_numpy(clip.template.faces.astype(np.int64)),
        fps=clip.fps,
        body_vertices=len(clip.body.rest),
    )


def _check_indices(model: MotionGuidedModel) -> None:
    """Raise ValueError where stored numbers of vertices or pixels are of none that is there."""
    maps, vertices = model.maps, len(model.maps.uvs)
    limits = (
        (model.seeds, int(model.body_vertices)),
        (model.faces, vertices),
        (maps.corners, vertices),
        (maps.pixels, maps.size**2),
        (model.parts, len(model.space.log_radius)),
    )
    for index, count in limits:
        if index.numel() and not 0 <= int(index.min()) <= int(index.max()) < count:
            raise ValueError(
                f"numbers from {int(index.min())} to {int(index.max())} of {count} vertices or pixels"
            )


def _empty(config: MotionGuidedConfig, tensors: dict[str, Tensor]) -> MotionGuidedModel:
    names = ("uvs", "pixels", "corners", "weights")
    maps = TextureMaps(config.uv_size, *(torch.zeros_like(tensors[f"maps.{name}"]) for name in names))
    return MotionGuidedModel(
        config,
        maps,
        seeds=torch.zeros_like(tensors["seeds"]),
        parts=tensors["parts"].clone(),
        radius=1.0,
        faces=torch.zeros_like(tensors["faces"]),
        fps=1.0,
        body_vertices=0,
    )
