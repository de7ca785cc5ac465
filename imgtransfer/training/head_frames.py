"""Training frames as a kernel head is fitted to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from imgtransfer.network.base import Guess
from imgtransfer.network.maps import BodyMaps, ImagePair
from imgtransfer.network.reading import read_frames
from imgtransfer.training.config import TrainingConfig
from imgtransfer.training.outfits import Outfit
from imgtransfer.training.validation import predicted_images
from render import decode_normals


@dataclass(frozen=True, eq=False)
class HeadFrames:
    """B frames.

    Args:
        body: what networks are shown of them, without a head.
        truth: the true images.
        predicted: what the networks predict that the run begins with, metres and unit; None where it begins with none.
        read: what those networks make of the frames, and where the run mirrors of the mirrored ones (`read_frames`);
            empty where the head does not read it.
    """

    body: BodyMaps
    truth: ImagePair
    predicted: Guess | None = None
    read: tuple[Tensor, ...] = ()

    @classmethod
    def of(cls, outfit: Outfit, body: BodyMaps, truth: ImagePair, training: TrainingConfig) -> HeadFrames:
        """Frames of an outfit, whose model is in evaluation."""
        if training.init is None:
            return cls(body, truth)  # the networks begin with 0
        assert body.guess is not None  # the configuration sees to it
        model, images = outfit.model, predicted_images(outfit, body)
        positions, normals = model.box.decode(images.positions), decode_normals(images.normals)
        predicted = replace(body.guess, positions=positions, normals=normals)
        if not reads_networks(training):
            return cls(body, truth, predicted)
        networks = (model.position_net, model.normal_net)
        return cls(body, truth, predicted, read_frames(networks, outfit.versions(), body.local))


def reads_networks(training: TrainingConfig) -> bool:
    """Whether a head is told what networks make of the frames: trained ones, that then stay as they are."""
    return training.init is not None and training.steps == 0
