"""Validation by geometry: some frames predicted, fused, and the vertices measured, as the commands would do it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from fusion import DecodedMaps, FusionInputs, MovingSurface, fuse
from imgtransfer.data.clip import Clip
from imgtransfer.data.reader import Reader
from imgtransfer.evaluation.sted import sted
from imgtransfer.network.history import earlier_steps
from imgtransfer.network.model import TransferModel
from render import decode_normals

RUN = 4  # frames that follow each other: STED also looks at how edges move


def chosen_runs(lengths: Sequence[int], frames: int) -> list[tuple[int, int]]:
    """Runs of `RUN` frames spread over clips, about `frames` in all: (clip, first frame) of each.

    Args:
        lengths: of the clips. A clip of one frame has no run, a shorter one than `RUN` a shorter run.
        frames: at least 2.
    """
    clips = [number for number, length in enumerate(lengths) if length > 1]
    count = max(1, frames // RUN)
    if len(clips) > count:
        clips = [clips[place] for place in np.linspace(0, len(clips) - 1, count).round().astype(int)]
    runs = []
    for place, clip in enumerate(clips):
        own = len(range(place, count, len(clips)))
        last = max(lengths[clip] - RUN, 0)
        runs += [(clip, round((number + 0.5) / own * last)) for number in range(own)]
    return runs


@torch.no_grad()
def measure_geometry(model: TransferModel, readers: Sequence[Reader], frames: int) -> dict[str, float]:
    """Predict and fuse runs of frames.

    Args:
        model: in evaluation mode, with the weights to judge.
        readers: of the validation clips.
        frames: about how many to fuse.

    Returns:
        fused_rmse_mm, the mean distance of a vertex to the truth, and fused_sted; nothing where no clip has two frames.

    Raises:
        InputError: damaged data, or a prediction that is not finite.
    """
    sums = {"fused_rmse_mm": 0.0, "fused_sted": 0.0}
    total = 0
    for number, first in chosen_runs([reader.n_frames for reader in readers], frames):
        reader = readers[number]
        before = _before(model, reader.clip(0, 1).fps)
        lead = min(first, before)
        clip = reader.clip(first - lead, min(first + RUN, reader.n_frames))
        rmse, edges = _measured(model, clip, lead)
        count = clip.n_frames - lead
        total += count
        sums["fused_rmse_mm"] += count * rmse
        sums["fused_sted"] += count * edges
    return {name: value / total for name, value in sums.items()} if total else {}


def _before(model: TransferModel, fps: float) -> int:
    """How many frames the networks look back."""
    return max((far for _, far, _ in earlier_steps(model.network.history_s, fps)), default=0)


def _measured(model: TransferModel, clip: Clip, lead: int) -> tuple[float, float]:
    """RMSE in millimetres, and STED, of the frames of a clip after its first `lead`, which are only looked back to."""
    prediction = model.predict(clip)
    shown = slice(lead, None)
    roots = prediction.frames.part(shown)
    inputs = FusionInputs(
        maps=DecodedMaps(prediction.metres()[shown], decode_normals(prediction.normals[shown])),
        body=MovingSurface(roots.to_canonical(clip.body.vertices[shown]), clip.body.faces),
        rest=prediction.rest_vertices,
        contact_offset_m=prediction.contact_offset_m,
    )
    fused = roots.to_world(fuse(prediction.imager, inputs).vertices)
    assert clip.garment is not None  # the training's frames see to it
    truth = clip.garment.vertices[shown]
    distance = np.linalg.norm(fused.astype(np.float64) - truth, axis=-1)
    return 1000 * float(distance.mean()), sted(fused, truth, clip.template_mesh.edges).whole
