"""What every method that predicts a garment's motion offers: fit it to clips, predict clips, store it.

A method is fitted to clips of one garment (the same faces, in one shape of the body or several). It sees of a clip what
a prediction may see: template, body, skeleton, rate; the garment's motion is the truth to fit to, and never an input.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from torch import Tensor

from imgtransfer.config.schema import Section
from imgtransfer.data.clip import Clip
from imgtransfer.training.config import DataConfig
from render import InputError, Option


@dataclass(frozen=True)
class FitFolder:
    """Where a method is fitted: what it keeps there lets a stopped fit go on.

    Args:
        path: the run's folder, which exists.
        seed: of all that is random.
        threads: of PyTorch's; None leaves the choice to the environment.
        data: where the clips come from, for a method that reads single frames by itself.
    """

    path: Path
    seed: int = 0
    threads: int | None = None
    data: DataConfig | None = None


class Deformer(ABC):
    """A method: made of its configuration, fitted to clips or restored from tensors, then asked for clips.

    Args:
        config: of the method's own class, `Config`.
    """

    name: ClassVar[str]  # in configurations and on the command line
    Config: ClassVar[type[Section]]

    def __init__(self, config: Section) -> None:
        self.config = config
        # Metres off the skin at which the cloth of the clips rests that it was fitted to; None: unknown.
        self.contact_offset_m: float | None = None

    @abstractmethod
    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        """Fit the method to clips; a stopped fit goes on from what `folder` holds of it.

        Args:
            clips: for training, with the garment's motion.
            folder: for intermediate results (`descend` keeps its state there).

        Raises:
            InputError: clips that the method cannot be fitted to; the message names the clip and what is wanted.
            KeyboardInterrupt: after Ctrl-C or SIGTERM, once what is done is saved.
        """

    @abstractmethod
    def predict(self, clip: Clip) -> np.ndarray:
        """The garment's vertices (T, N, 3) float32, world metres, of all frames in their order.

        The garment's motion in `clip` is not looked at.

        Raises:
            InputError: a clip of another garment, or without what the method needs.
        """

    def check(self, still: Clip) -> None:
        """Whether the method can predict a clip, told from its first frame, before any work.

        Raises:
            InputError: a clip of another garment, or without what the method needs.
        """
        self.predict(still)

    @abstractmethod
    def tensors(self) -> dict[str, Tensor]:
        """Everything that was fitted, by name, for a safetensors file."""

    @abstractmethod
    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Put back what `tensors` gave.

        Raises:
            ValueError: not what this method with this configuration has.
        """

    def parameters(self) -> int:
        """How many numbers were fitted."""
        return sum(value.numel() for value in self.tensors().values())


def same_garment(clips: Sequence[Clip]) -> Clip:
    """The first of clips of one garment, each with its motion.

    Raises:
        InputError: no clips, other faces, or a clip without the garment's motion.
    """
    if not clips:
        raise InputError("no clips to fit to; choose some with data.train")
    first = clips[0]
    for clip in clips:
        if clip.garment is None:
            raise InputError(
                f"{clip.name}: has no garment_vertices, and clips to fit to need the garment's motion"
            )
        if not np.array_equal(clip.template.faces, first.template.faces):
            raise InputError(
                f"{clip.name}: another garment ({len(clip.template.faces)} faces) than that of {first.name} "
                f"({len(first.template.faces)}); a method is fitted to one garment, choose clips with data.train.names"
            )
    return first


def check_faces(clip: Clip, faces: np.ndarray) -> None:
    """Raise InputError where a clip is of another garment than that with these faces (F, 3)."""
    if not np.array_equal(clip.template.faces, faces):
        raise InputError(
            f"{clip.name}: another garment ({len(clip.template.vertices)} vertices, {len(clip.template.faces)} faces) "
            f"than that which the method was fitted to ({len(faces)} faces); choose clips with {Option('clips')}"
        )
