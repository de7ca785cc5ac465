"""What the paper measures: roll-out errors (table 3) and penetration by motion (table 2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice

import numpy as np
import torch

from fusion.obstacles.sdf import BodySdf
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.motion_guided.method import MotionGuided
from imgtransfer.deformers.motion_guided.training import HISTORY

LENGTHS = (1, 50, None)  # frames of a roll-out; None goes to the clip's end


def rollout_errors_mm(
    deformer: MotionGuided, clip: Clip, *, lengths: Sequence[int | None] = LENGTHS, starts: int = 8
) -> dict[str, float]:
    """Mean distance from the truth over the frames of roll-outs that begin after true frames (table 3).

    Args:
        clip: at the rate of the fit, with the garment's motion and more than three frames.
        lengths: frames of a roll-out; None goes from the clip's third frame to its end.
        starts: roll-outs of each length, spread over the clip as far as they fit into it.

    Returns:
        Millimetres by length ("1", "50", "all"); a length that the clip does not have is left out.
    """
    assert clip.garment is not None
    truth, rollout, errors = clip.garment.vertices, deformer.rollout(clip), {}
    for length in lengths:
        count = clip.n_frames - HISTORY if length is None else length
        last = clip.n_frames - count
        if last < HISTORY or count < 1:
            continue
        distances = []
        for first in np.unique(np.linspace(HISTORY, last, starts).round().astype(int)):
            history = [truth[first - 1], truth[first - 2], truth[first - 3]]
            frames = np.stack(list(islice(rollout.frames(history, int(first)), count)))
            distances.append(np.linalg.norm(frames - truth[first : first + count], axis=-1).mean())
        errors["all" if length is None else str(length)] = 1e3 * float(np.mean(distances))
    return errors


def penetration_percent(clips: Mapping[str, tuple[Clip, np.ndarray]]) -> dict[str, float]:
    """Vertices inside the body in per cent of all, for each test motion (table 2).

    Args:
        clips: by the motion's name, a clip and its predicted garment (T, N, 3), metres.
    """
    percent = {}
    for name, (clip, garment) in clips.items():
        surface = BodySdf(clip.body.faces, len(clip.body.rest))
        inside = 0
        for pose, cloth in zip(clip.body.vertices, garment, strict=True):
            surface.update(pose)
            inside += int((surface.query(torch.from_numpy(cloth)).distance < 0).sum())
        percent[name] = 100 * inside / (garment.shape[0] * garment.shape[1])
    return percent
