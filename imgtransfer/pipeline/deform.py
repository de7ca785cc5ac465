"""The whole method in one call: a body in motion in, the deformed garment out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fusion import DecodedMaps, FusionConfig, FusionInputs, MovingSurface, fuse
from imgtransfer.data.clip import Clip
from render import decode_normals

if TYPE_CHECKING:
    from imgtransfer.network.model import TransferModel
    from imgtransfer.network.prediction import Prediction


@dataclass(frozen=True, eq=False)
class Deformation:
    """A clip deformed by a model.

    Args:
        prediction: the maps.
        position_only: (T, N, 3) float32, metres, world: read from the position maps, nothing optimised.
        fused: (T, N, 3) float32, metres, world: after both stages of the fusion (section 3.3).
        report: what `fusion.fuse` says of the optimisation.
    """

    prediction: Prediction
    position_only: np.ndarray
    fused: np.ndarray
    report: dict[str, Any]


def deform(
    model: TransferModel,
    clip: Clip,
    config: FusionConfig | None = None,
    *,
    progress: Callable[[int], object] | None = None,
) -> Deformation:
    """Predict the maps of every frame and fuse them over the clip's body; the clip's own garment motion is not used.

    Args:
        model: from `imgtransfer.training.checkpoint.load_model`.
        clip: a body in motion and the model's garment, in the shape of that body.
        config: of the fusion; the paper's if None.
        progress: called with a number of frames after each batch that is fused.

    Raises:
        InputError: the clip's garment is not the model's.
    """
    prediction = model.predict(clip)
    inputs = FusionInputs(
        maps=DecodedMaps(prediction.metres(), decode_normals(prediction.normals)),
        body=MovingSurface(prediction.frames.to_canonical(clip.body.vertices), clip.body.faces),
        rest=prediction.rest_vertices,
        contact_offset_m=prediction.contact_offset_m,
    )
    result = fuse(prediction.imager, inputs, config, progress=progress)
    to_world = prediction.frames.to_world
    return Deformation(prediction, to_world(result.initial), to_world(result.vertices), result.report)
