"""Position and normal maps of a clip to vertices: section 3.3 of the paper from end to end."""

from __future__ import annotations

from collections.abc import Callable

import torch

from fusion.config import FusionConfig
from fusion.inputs import Array, FusionInputs
from fusion.stream import FusionResult, collected, fuse_batches, slices
from render.maps.imager import TemplateImager


def fuse(
    imager: TemplateImager,
    *,
    positions: Array | None = None,
    normals: Array | None = None,
    initial: Array | None = None,
    rest: Array | None = None,
    confidence: Array | None = None,
    pinned: Array | None = None,
    pinned_positions: Array | None = None,
    body_vertices: Array | None = None,
    body_faces: Array | None = None,
    inner_vertices: Array | None = None,
    inner_faces: Array | None = None,
    config: FusionConfig | None = None,
    device: str | torch.device = "cpu",
    history: bool = False,
    progress: Callable[[int], object] | None = None,
) -> FusionResult:
    """Recover the garment from its maps.

    With position maps: initialisation and edge stage. Then, if there are normals or something to stay outside of, the
    second stage with the terms that they allow, and the clean-up. Unless `config` couples them (`weight_temporal`,
    `warm_start`), frames are independent: the result does not depend on how they are batched beyond float rounding.
    It repeats exactly on the CPU.

    The garment's collisions with itself are not handled.

    Args:
        imager: of the garment's template, with the cameras of the maps.
        positions: (T, S, H, W, 3) metres (decoded by their box).
        normals: (T, S, H, W, 3) in [-1, 1] (decoded); only their directions count.
        initial: (T, N, 3) metres, vertices to start from instead of `positions`.
        rest: (N, 3) metres, the garment whose edge lengths are kept, where it is not the imager's template: the same
            garment refitted to another body. Pixels and cameras stay the imager's.
        confidence: (T, S, H, W) at least 0, what each pixel counts in the readings of the position maps, in holding
            vertices to their readings, and in the normal term; 1 is as usual, and everywhere 1 is as None. Pixels
            with 0 are ignored, and vertices of which nothing else shows are treated as unseen.
        pinned: (P,) integers, vertices that are held exactly.
        pinned_positions: (T, P, 3) metres, where; None: where they start.
        body_vertices: (T, B, 3) metres, in the frame of the maps.
        body_faces: (G, 3) integers, counter-clockwise from outside.
        inner_vertices: (T, M, 3) metres, another garment worn beneath, whose outer surface this one stays outside of.
        inner_faces: (K, 3) integers, counter-clockwise from outside.
        config: hyper-parameters; the defaults if None.
        device: torch device that computes.
        history: whether to report the terms at every iteration.
        progress: called with the number of frames after each batch of them.

    Raises:
        InputError: neither or both of `positions` and `initial`; shapes that do not fit; values under the
            mask that are not finite; a template that no view sees; a `rest` of another size; a body turned
            inside out.
    """
    config = config or FusionConfig()
    inputs = FusionInputs(
        imager,
        positions=positions,
        normals=normals,
        initial=initial,
        rest=rest,
        confidence=confidence,
        pinned=pinned,
        pinned_positions=pinned_positions,
        body_vertices=body_vertices,
        body_faces=body_faces,
        inner_vertices=inner_vertices,
        inner_faces=inner_faces,
    )
    weighted = inputs.confidence is not None and bool((inputs.confidence[:, imager.mask] != 1).any())
    return collected(
        lambda take: fuse_batches(
            imager,
            inputs.n_frames,
            lambda size: (inputs.part(frames) for frames in slices(inputs.n_frames, size)),
            take,
            config=config,
            device=device,
            weighted=weighted,
            history=history,
            progress=progress,
        )
    )
