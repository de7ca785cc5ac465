"""Validation: frames spread over the validation clips, predicted as `imgtransfer predict` does, measured as maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from imgtransfer.network.loss import frame_distances, map_errors
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.model import TransferModel
from imgtransfer.training.outfits import Outfit
from imgtransfer.training.processes import Processes
from imgtransfer.training.sampler import Frames

VALIDATION_BATCH = 16


@dataclass(frozen=True, eq=False)
class FrameImages:
    """One validation frame.

    Args:
        frame: its number.
        predicted, truth: encoded images, (1, S, H, W, 3) each.
        model: with the silhouette and the position box that they are encoded by.
    """

    frame: int
    predicted: ImagePair
    truth: ImagePair
    model: TransferModel


class Validation:
    """Predicts validation frames, in float32 as `imgtransfer predict` does, whatever the training computes in.

    Args:
        frames: of the validation clips.
        count: how many of them each validation measures.
        batch: maps and true images of frames of one outfit.
        outfit: of frames of one outfit.
        processes: that share the work.
    """

    def __init__(
        self,
        frames: Frames,
        count: int,
        *,
        batch: Callable[[Frames, Tensor], tuple[BodyMaps, ImagePair]],
        outfit: Callable[[Frames, Tensor], Outfit],
        processes: Processes,
    ) -> None:
        self._frames, self._index = frames, frames.spread(count)
        self._batch, self._outfit = batch, outfit
        self._processes = processes
        self.worst: tuple[int, float] | None = (
            None  # frame, and its mean distance in mm, of the last validation
        )

    @torch.no_grad()
    def __call__(self) -> dict[str, float]:
        """Mean errors over the covered pixels.

        Returns:
            position_mm, the distance to the true position; normal_degrees, the angle to the true normal; and
            where there is a first guess the same of it, as guess_position_mm and guess_normal_degrees.
        """
        processes = self._processes
        index = self._index[processes.number :: processes.count]
        # A process without a frame of its own measures one that counts nothing, so that all give the same numbers.
        counted = len(index) > 0
        sums: dict[str, float] = {}
        worst = (0, 0.0)
        for part in self._parts(index if counted else self._index[:1]):
            errors, distances = self._errors(part)
            for key, value in errors.items():
                sums[key] = sums.get(key, 0.0) + counted * value * len(part) / len(self._index)
            place = int(distances.argmax())
            if distances[place] > worst[1]:
                worst = int(part[place]), float(distances[place])
        self.worst = self._worst_of_all(*worst)
        return processes.total(sums)

    def _worst_of_all(self, frame: int, error: float) -> tuple[int, float] | None:
        """The worst frame of any process, of which each gives its own; None where no frame has an error."""
        numbers = range(self._processes.count)
        mine = self._processes.number
        values = {f"error {n}": error * (n == mine) for n in numbers}
        values |= {f"frame {n}": float(frame * (n == mine)) for n in numbers}
        known = self._processes.total(values)
        worst = max(numbers, key=lambda n: known[f"error {n}"])
        if known[f"error {worst}"] == 0:
            return None
        return int(known[f"frame {worst}"]), known[f"error {worst}"]

    @torch.no_grad()
    def images(self, index: Tensor) -> list[FrameImages]:
        """Predicted and true images of frames `index` (B,), in the order of their numbers."""
        shown = []
        for part in self._parts(index):
            model = self._outfit(self._frames, part).model
            predicted, truth, _ = self._predicted(part)
            for place, frame in enumerate(part.tolist()):
                one = slice(place, place + 1)
                pairs = [ImagePair(pair.positions[one], pair.normals[one]) for pair in (predicted, truth)]
                shown.append(FrameImages(frame, pairs[0], pairs[1], model))
        return sorted(shown, key=lambda images: images.frame)

    def _parts(self, index: Tensor) -> Iterator[Tensor]:
        """Frames of one outfit at a time."""
        for together in index.split(VALIDATION_BATCH):
            for _, places in self._frames.by_outfit(together):
                yield together[places]

    def _errors(self, index: Tensor) -> tuple[dict[str, float], Tensor]:
        """The same of frames `index` (B,) of one outfit, and (B,) each one's mean distance in millimetres."""
        model = self._outfit(self._frames, index).model
        predicted, truth, body = self._predicted(index)
        errors = map_errors(predicted, truth, model.mask, model.box)
        if body.guess is not None:
            guess = ImagePair.encode(body.guess.positions, body.guess.normals, model.mask, model.box)
            guessed = map_errors(guess, truth, model.mask, model.box)
            errors |= {f"guess_{key}": value for key, value in guessed.items()}
        return errors, 1000 * frame_distances(predicted, truth, model.mask, model.box)

    def _predicted(self, index: Tensor) -> tuple[ImagePair, ImagePair, BodyMaps]:
        """Predicted and true images of frames `index` (B,) of one outfit, and what the networks were shown."""
        outfit = self._outfit(self._frames, index)
        body, truth = self._batch(self._frames, index)
        return predicted_images(outfit, body), truth, body


def predicted_images(outfit: Outfit, body: BodyMaps) -> ImagePair:
    """Images of an outfit's frames, averaged with those of the mirrored scene where the run mirrors."""
    if outfit.mirror is None:
        images: ImagePair = outfit.model(body, garment=outfit.garment)
        return images
    return outfit.model.averaged(body, outfit.mirror, outfit.versions())
