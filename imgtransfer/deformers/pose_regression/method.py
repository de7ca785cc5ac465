"""The deformer `pose_regression`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np
import torch
from annotated_types import Unit
from pydantic import Field
from torch import Tensor

from imgtransfer.config.schema import Seconds
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder, same_garment
from imgtransfer.deformers.lbs.method import LbsConfig, skinned, skinned_of, skinned_tensors
from imgtransfer.deformers.lbs.skinned import SkinnedGarment, posed, turns
from imgtransfer.deformers.pose_regression.features import SIZE, pose_features
from imgtransfer.deformers.pose_regression.mirror import Mirror
from imgtransfer.deformers.pose_regression.regression import KernelRegression, one_width
from imgtransfer.deformers.pose_regression.selection import choose
from imgtransfer.training.left_out import left_out_groups
from render import InputError

_SELECTING = 400  # frames at most that widths are chosen on
_PLAIN = np.sqrt([1.0, 0.3])  # scales of a joint now and before, in the regression that chooses none
_PLAIN_RIDGE = 0.1


class PoseRegressionConfig(LbsConfig):
    """Kernel ridge regression from joint rotations, and what they were a moment ago, to the residual to `lbs`."""

    joints: int = Field(
        12, ge=1, le=1000, description="The joints that count most for the training clips are kept."
    )
    history_s: Seconds = Field(
        0.133, ge=0, le=10, description="How long ago the earlier rotations were; 4 frames at 30 a second."
    )
    steps: int = Field(
        100,
        ge=1,
        le=100_000,
        description="Steps of the descent that chooses kernel widths and ridge on training clips that are left out: "
        "once for all joints, once for those that are kept.",
    )
    groups: int = Field(
        4,
        ge=2,
        le=100,
        description="Parts that the training clips, in the order of their names, are cut into to be left out in turn. "
        "Clips of one motion should fall into one part, or widths come out too small "
        "for others.",
    )
    most_frames: Annotated[int, Unit("frames")] = Field(
        3000,
        ge=2,
        le=20_000,
        description="Training frames at most, evenly taken, mirror images included; memory grows with their square.",
    )
    mirror: bool = Field(
        True,
        description="Whether to fit to the mirror image of every frame as well, where skeleton and garment at rest are "
        "alike on the left and the right; where they are not, it is left out.",
    )


class PoseRegression(Deformer):
    """What skinning lacks is regressed vertex by vertex in the axes of each vertex's own rotation, then posed.

    x = Σ_k w_k T_k x₀ + R r(pose), R being the rotation nearest to the blended transform Σ_k w_k T_k, and r the mean of
    two `KernelRegression`s of the same joints: one whose kernel widths and ridge, as the joints, are those that predict
    training clips best that are left out, and one of the same width for all, whose errors are others.
    Mirror images of the training frames, where there are such, are left out with them.
    """

    name: ClassVar[str] = "pose_regression"
    Config = PoseRegressionConfig
    garment: SkinnedGarment
    joints: np.ndarray  # (J,) int
    scales: np.ndarray  # (2, J, 2) float64, of both regressions, of each joint now and before
    regressions: tuple[KernelRegression, KernelRegression]

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        config = self._settings()
        self.garment = skinned(
            same_garment(clips), LbsConfig.model_validate(config.model_dump(include=_OF_LBS))
        )
        features = [pose_features(clip, config.history_s) for clip in clips]
        _check_joints(clips, features)
        lengths = [clip.n_frames for clip in clips]
        mirror = Mirror.of(clips[0]) if config.mirror else None
        images = 1 if mirror is None else 2
        taken = _spread(sum(lengths), max(2, config.most_frames // images))
        starts = np.repeat(np.cumsum([0, *lengths[:-1]]), lengths)
        groups = left_out_groups(starts, config.groups).numpy()
        if len(np.unique(groups)) < 2:
            raise InputError(
                f"{clips[0].name}: one frame, and pose_regression needs two at least to be fitted to"
            )
        seen = np.concatenate(features)[taken]
        residuals = np.concatenate(
            [
                self._residual(clip)[_of_clip(taken, start, clip)]
                for clip, start in zip(clips, np.unique(starts), strict=True)
            ]
        )
        few = _spread(len(taken), _SELECTING // images)
        groups = groups[taken]
        if mirror is not None:
            seen = np.concatenate([seen, mirror.features(seen)])
            residuals = np.concatenate([residuals, mirror.residuals(residuals)])
            few, groups = np.concatenate([few, len(taken) + few]), np.tile(groups, 2)
        choice = choose(seen[few], residuals[few], groups[few], joints=config.joints, steps=config.steps)
        self.joints = choice.joints
        plain = np.broadcast_to(_PLAIN, choice.scales.shape)
        self.scales = np.stack([choice.scales, one_width(self._scaled(seen, plain)) * plain])
        # Of more frames each has more neighbours, whose noise the ridge averages.
        ridges = (choice.ridge * len(seen) / len(few), _PLAIN_RIDGE)
        first, second = (
            KernelRegression.fit(self._scaled(seen, scales), residuals, ridge)
            for scales, ridge in zip(self.scales, ridges, strict=True)
        )
        self.regressions = first, second

    def predict(self, clip: Clip) -> np.ndarray:
        blended = self.garment.blended(clip)
        features = pose_features(clip, self._settings().history_s)
        if features.shape[1] <= self.joints.max():
            raise InputError(
                f"{clip.name}: {features.shape[1]} joints in poses, and the method was fitted to more; clips of one "
                "skeleton are wanted"
            )
        predicted = [
            one(self._scaled(features, scales))
            for one, scales in zip(self.regressions, self.scales, strict=True)
        ]
        residual = np.mean(predicted, axis=0).reshape(len(features), -1, 3)
        moved = (
            posed(blended, clip.template.vertices) + np.matmul(turns(blended), residual[..., None])[..., 0]
        )
        return moved.astype(np.float32)

    def tensors(self) -> dict[str, Tensor]:
        values = {
            "joints": self.joints.astype(np.int64),
            "scales": self.scales,
            "support": np.stack([one.support for one in self.regressions]),
            "coefficients": np.stack([one.coefficients for one in self.regressions]),
            "mean": self.regressions[0].mean,
        }
        return skinned_tensors(self.garment) | {key: torch.from_numpy(value) for key, value in values.items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        self.garment = skinned_of(tensors)
        count = tensors["support"].shape[1] if tensors["support"].ndim == 3 else 0
        joints = len(tensors["joints"])
        wanted = {
            "joints": (joints,),
            "scales": (2, joints, 2),
            "support": (2, count, 2 * SIZE * joints),
            "coefficients": (2, count, 3 * len(self.garment.weights)),
            "mean": (3 * len(self.garment.weights),),
        }
        for key, shape in wanted.items():
            if tensors[key].shape != shape:
                raise ValueError(f"{key} has shape {tuple(tensors[key].shape)}, {shape} is wanted")
        if joints == 0 or int(tensors["joints"].min()) < 0:
            raise ValueError("joints must be numbers from 0 on")
        values = {key: tensors[key].numpy() for key in wanted}
        self.joints, self.scales = values["joints"], values["scales"]
        first, second = (
            KernelRegression(support, coefficients, values["mean"])
            for support, coefficients in zip(values["support"], values["coefficients"], strict=True)
        )
        self.regressions = first, second

    def _settings(self) -> PoseRegressionConfig:
        assert isinstance(self.config, PoseRegressionConfig)
        return self.config

    def _residual(self, clip: Clip) -> np.ndarray:
        """What skinning lacks, in each vertex's own axes: (T, 3 N) float32, metres."""
        assert clip.garment is not None
        blended = self.garment.blended(clip)
        lacking = clip.garment.vertices - posed(blended, clip.template.vertices)
        own = np.matmul(np.swapaxes(turns(blended), -1, -2), lacking[..., None])[..., 0]
        return own.reshape(len(own), -1).astype(np.float32)

    def _scaled(self, features: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """(T, J, 2, 9) of all joints -> (T, D) of those that count, by their scales now and before, (J, 2)."""
        return (features[:, self.joints] * scales[..., None]).reshape(len(features), -1)


_OF_LBS = set(LbsConfig.model_fields)


def _check_joints(clips: Sequence[Clip], features: Sequence[np.ndarray]) -> None:
    """Raise InputError where clips have other joints than the first."""
    for clip, seen in zip(clips, features, strict=True):
        if seen.shape[1] != features[0].shape[1]:
            raise InputError(
                f"{clip.name}: {seen.shape[1]} joints in poses, and {features[0].shape[1]} in those of "
                f"{clips[0].name}; clips of one skeleton are wanted"
            )


def _spread(count: int, most: int) -> np.ndarray:
    """At most so many of `count` indices, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def _of_clip(taken: np.ndarray, start: int, clip: Clip) -> np.ndarray:
    """Which of a clip's frames are among those taken of all."""
    return taken[(taken >= start) & (taken < start + clip.n_frames)] - start
