"""Position and normal maps of a clip to vertices: section 3.3 of the paper from end to end."""

from __future__ import annotations

from collections.abc import Callable

import torch

from fusion.config import FusionConfig
from fusion.input_checks import checked
from fusion.inputs import FusionInputs
from fusion.stream import FrameStream, FusionResult, collected, fuse_batches, slices
from render.maps.imager import TemplateImager


def fuse(
    imager: TemplateImager,
    inputs: FusionInputs,
    config: FusionConfig | None = None,
    *,
    device: str | torch.device = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from its maps.

    With position maps: initialisation and edge stage. Then, if there are normals or something to stay outside of, the
    second stage with the terms that they allow, and the clean-up. Unless `config` couples them (`smooth_time_s`,
    `warm_start`), frames are independent: the result does not depend on how they are batched beyond float rounding.
    It repeats exactly on the CPU.

    The garment's collisions with itself are handled where `config.self_contact` asks for it.

    Args:
        imager: of the garment's template, with the cameras of the maps.
        inputs: T frames of maps or of vertices to start from, and what they are fused with.
        config: hyper-parameters; the defaults if None.
        device: torch device that computes.
        history: whether to report the terms at every iteration.
        progress: called with the number of frames after each batch of them.

    Returns:
        Vertices (T, N, 3) float32, metres, before and after; and the report.

    Raises:
        InputError: neither or both of position maps and `initial`; shapes that do not fit; values in the template's
            pixels that are not finite; a template that no view sees; a `rest` of another size; a body turned
            inside out; smoothing over time without `fps`, or over less than two frames.
    """
    inputs = checked(inputs, imager)
    confidence = inputs.maps.confidence
    frames = FrameStream(
        inputs.n_frames,
        lambda size: (inputs.part(frames) for frames in slices(inputs.n_frames, size)),
        weighted=confidence is not None and bool((confidence[:, imager.mask] != 1).any()),
        fps=inputs.fps,
    )
    return collected(
        lambda take: fuse_batches(
            imager, frames, take, config, device=device, history=history, progress=progress
        )
    )
