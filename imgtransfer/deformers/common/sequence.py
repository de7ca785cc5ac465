"""What methods share that read the body's motion frame after frame: clips to features and back, in the root's frame."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.data.canonical import RootFrames, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder, same_garment
from imgtransfer.deformers.common.body_motion import BodyMotion, body_motion, joint_features, root_features
from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.rates import at_frames, at_samples, same_rate
from render import InputError


@dataclass(frozen=True, eq=False)
class Known:
    """What a fitted method knows of its clips.

    Args:
        faces: (F, 3) int64 of the garment. template: (N, 3) float32, the first clip's, metres.
        parents: (J,) of the joints, -1 for the root. fps: frames a second.
    """

    faces: np.ndarray
    template: np.ndarray
    parents: np.ndarray
    fps: float

    def tensors(self) -> dict[str, Tensor]:
        """All of it, for a file."""
        return {
            "known.faces": torch.from_numpy(self.faces.astype(np.int64)),
            "known.template": torch.from_numpy(self.template.astype(np.float32)),
            "known.parents": torch.from_numpy(self.parents.astype(np.int64)),
            "known.fps": torch.tensor([self.fps], dtype=torch.float64),
        }

    @classmethod
    def of_tensors(cls, tensors: dict[str, Tensor]) -> Known:
        """What `tensors` gave.

        Raises:
            ValueError: something is missing, or of a shape that it cannot have.
        """
        wanted = {"faces": (None, 3), "template": (None, 3), "parents": (None,), "fps": (1,)}
        arrays = {}
        for name, shape in wanted.items():
            value = tensors.get(f"known.{name}")
            if value is None or value.ndim != len(shape):
                raise ValueError(f"known.{name} is missing, or not of {len(shape)} axes")
            if any(want not in (None, size) for want, size in zip(shape, value.shape, strict=True)):
                raise ValueError(f"known.{name} has shape {tuple(value.shape)}")
            arrays[name] = value.numpy()
        return cls(arrays["faces"], arrays["template"], arrays["parents"], float(arrays["fps"][0]))


@dataclass(frozen=True, eq=False)
class Given:
    """What a network is told of a clip.

    Args:
        root: (T, 9) float32, joints: (T, J - 1, 6) float32, see `body_motion`.
        template: (N, 3) float32, metres. body_rest: (B, 3), metres.
        body: makes (T, B, 3) float32 in the root's frame, metres, where that is asked for.
    """

    root: Tensor
    joints: Tensor
    template: Tensor
    body_rest: np.ndarray
    body: Callable[[], np.ndarray]


@dataclass(frozen=True, eq=False)
class FitClips:
    """The frames of all clips to fit to, one clip after the other; S in all.

    Args:
        known: of all of them.
        given: of each clip. lengths: their frames.
        root: (S, 9) float32, joints: (S, J - 1, 6) float32, see `body_motion`.
        positions: (S, N, 3) float32, the garment in the root's frame, metres.
        templates: (C, N, 3) float32, a clip each. clip_of: (S,) int64, which clip a frame is of.
    """

    known: Known
    given: tuple[Given, ...]
    lengths: tuple[int, ...]
    root: Tensor
    joints: Tensor
    positions: Tensor
    templates: Tensor
    clip_of: Tensor


class SequenceDeformer(Deformer):
    """A method with one network from the body's motion to the garment in the root's frame."""

    _known: Known | None = None
    _network: nn.Module | None = None

    @abstractmethod
    def _fitted(self, clips: FitClips, folder: FitFolder) -> nn.Module:
        """The network fitted to clips, ready to predict."""

    @abstractmethod
    def _empty(self, known: Known, tensors: dict[str, Tensor]) -> nn.Module:
        """The network before its tensors are put into it; their shapes tell its sizes."""

    @abstractmethod
    def _canonical(self, network: nn.Module, given: Given) -> Tensor:
        """The garment (T, N, 3) in the root's frame."""

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        """See `Deformer.fit`."""
        gathered = gather(clips)
        self._network = self._fitted(gathered, folder).eval()
        self._known = gathered.known

    @torch.no_grad()
    def predict(self, clip: Clip) -> np.ndarray:
        """See `Deformer.predict`; a clip of another frame rate is resampled there and back."""
        assert self._known is not None
        assert self._network is not None
        known = self._known
        _check_garment(clip, known)
        frames = root_frames(clip, "root")
        motion = body_motion(clip, frames)
        _check_joints(clip, motion, known)
        same = same_rate(clip.fps, known.fps)
        try:
            given = _given(clip, motion if same else motion.at(known.fps), frames)
        except InputError as error:
            raise InputError(f"{clip.name}: {error}") from error
        predicted = self._canonical(self._network, given).numpy()
        if not same:
            predicted = at_frames(predicted, clip.n_frames, clip.fps, known.fps)
        return frames.to_world(predicted)

    def parameters(self) -> int:
        """See `Deformer.parameters`: of the network, and the skinning weights that are not 0."""
        assert self._network is not None
        skinnings = [part for part in self._network.modules() if isinstance(part, BoneSkinning)]
        learned = sum(value.numel() for value in self._network.parameters())
        return learned + sum(int((part.weights != 0).sum()) for part in skinnings)

    def tensors(self) -> dict[str, Tensor]:
        """See `Deformer.tensors`."""
        assert self._known is not None
        assert self._network is not None
        weights = self._network.state_dict()
        return self._known.tensors() | {f"network.{key}": value for key, value in weights.items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """See `Deformer.restore`."""
        known = Known.of_tensors(tensors)
        start = "network."
        weights = {key.removeprefix(start): value for key, value in tensors.items() if key.startswith(start)}
        try:
            network = self._empty(known, weights)
            network.load_state_dict(weights, strict=True)
        except (KeyError, IndexError, RuntimeError) as error:
            raise ValueError(f"the tensors of {self.name} are of other settings, or damaged") from error
        self._known, self._network = known, network.eval()


def gather(clips: Sequence[Clip]) -> FitClips:
    """Clips of one garment as features and as vertices in the root's frame.

    Raises:
        InputError: clips of several garments, frame rates or numbers of joints, without poses or motion.
    """
    first = same_garment(clips)
    given, positions = [], []
    for clip in clips:
        if not same_rate(clip.fps, first.fps):
            raise InputError(
                f"{clip.name}: {clip.fps:g} frames a second, {first.name} has {first.fps:g}; a method is fitted to "
                "clips of one frame rate, choose such with data.train.names (it predicts at any)"
            )
        frames = root_frames(clip, "root")
        motion = body_motion(clip, frames)
        if clip is first:
            known = Known(first.template.faces, first.template.vertices, _parents(first), first.fps)
        _check_joints(clip, motion, known)
        assert clip.garment is not None
        given.append(_given(clip, motion, frames))
        positions.append(torch.from_numpy(frames.to_canonical(clip.garment.vertices)))
    lengths = tuple(len(own.root) for own in given)
    return FitClips(
        known,
        tuple(given),
        lengths,
        torch.cat([own.root for own in given]),
        torch.cat([own.joints for own in given]),
        torch.cat(positions),
        torch.stack([own.template for own in given]),
        torch.repeat_interleave(torch.arange(len(clips)), torch.tensor(lengths)),
    )


def _given(clip: Clip, motion: BodyMotion, frames: RootFrames) -> Given:
    """What is told of a clip at the rate of `motion`."""

    def body() -> np.ndarray:
        posed = frames.to_canonical(clip.body.vertices)
        return posed if same_rate(clip.fps, motion.fps) else at_samples(posed, clip.fps, motion.fps)

    return Given(
        torch.from_numpy(root_features(motion)),
        torch.from_numpy(joint_features(motion)),
        torch.from_numpy(clip.template.vertices),
        clip.body.rest,
        body,
    )


def _parents(clip: Clip) -> np.ndarray:
    skeleton = clip.skeleton
    assert skeleton.poses is not None
    if skeleton.parents is None or len(skeleton.parents) < skeleton.poses.shape[1]:
        raise InputError(
            f"{clip.name}: has no parents of its {skeleton.poses.shape[1]} joints; give the skeleton's (J,) parents, "
            "-1 for the root"
        )
    return skeleton.parents[: skeleton.poses.shape[1]]


def _check_joints(clip: Clip, motion: BodyMotion, known: Known) -> None:
    count = motion.joints.shape[1] + 1
    if count != len(known.parents):
        raise InputError(
            f"{clip.name}: poses of {count} joints, and the method was fitted to {len(known.parents)}; give poses "
            "of the same skeleton"
        )


def _check_garment(clip: Clip, known: Known) -> None:
    if not np.array_equal(clip.template.faces, known.faces):
        raise InputError(
            f"{clip.name}: another garment ({len(clip.template.vertices)} vertices, {len(clip.template.faces)} faces) "
            f"than the method was fitted to ({len(known.template)} vertices, {len(known.faces)} faces); fit one to it"
        )
