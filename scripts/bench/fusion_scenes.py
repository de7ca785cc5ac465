"""Scenes of the sample data to judge a fusion by: clips of cloth with maps that are true, disturbed or predicted.

Maps show front and back, 128 x 128 pixels, in the canonical frame `root`; metres.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import open_clips
from imgtransfer.training.checkpoint import load_model
from render import Mesh, TemplateImager, vertex_normals
from scripts.bench.fusion import Scene, blurred

PROJECT = Path(__file__).resolve().parents[2]
SAMPLE, MODEL = PROJECT / "configs" / "sample_data", PROJECT / "configs" / "pretrained"
GARMENTS, BEND, PUNCH = ("tshirt", "dress", "trousers", "skirt"), "bend_s102", "punch_s101"
SIZE = 128
BLUR, NOISE_BLUR, NOISE_M = 2.0, 6.0, 0.008  # pixels, pixels, metres a component
OUTLIERS, OUTLIER_M = 0.1, 0.2  # fraction of the covered pixels, metres a component
SLEEVE, SLEEVE_M = (
    0.75,
    0.1,
)  # of the template's half width, where a sleeve begins; metres that it is moved up


def sample_clip(garment: str, name: str, frames: slice) -> Clip:
    """Some frames of a clip of the sample data, such as ("dress", "bend_s102")."""
    return open_clips(SAMPLE / f"{garment}.zarr.zip", names=[f"{garment}/{name}"])[0].slice(frames)


def true_scene(clip: Clip, *, size: int = SIZE) -> Scene:
    """A clip with its garment, and the maps that show it as it is."""
    assert clip.garment is not None
    imager = TemplateImager.build(Mesh(clip.template.vertices, clip.template.faces), size=(size, size))
    frames = root_frames(clip, "root")
    truth = frames.to_canonical(clip.garment.vertices)
    points = torch.from_numpy(truth)
    positions, normals = imager.operator(points), imager.operator(vertex_normals(points, imager.faces))
    bodies = frames.to_canonical(clip.body.vertices)
    return Scene(imager, truth, positions, normals, Mesh(clip.body.rest, clip.body.faces), bodies)


def at_rest(clip: Clip, *, size: int = SIZE) -> Scene:
    """The clip's template, as it is, in one frame."""
    still = replace(true_scene(clip.slice(slice(1)), size=size), bodies=clip.body.rest[None])
    points = torch.from_numpy(clip.template.vertices.astype(np.float32))[None]
    imager = still.imager
    normals = imager.operator(vertex_normals(points, imager.faces))
    return replace(still, truth=points.numpy(), positions=imager.operator(points), normals=normals)


def predicted_scene(name: str, step: int, frames: slice) -> Scene:
    """What configs/pretrained predicts for a clip of its T-shirt: `frames` of every `step`-th frame.

    Predicted is the whole clip, as the model looks at where the body was fractions of a second before.
    """
    clip = sample_clip("tshirt", name, slice(None))
    prediction = load_model(MODEL).predict(clip)
    true = true_scene(clip.slice(slice(None, None, step)).slice(frames))
    chosen = np.arange(clip.n_frames)[::step][frames]
    normals = torch.where(prediction.imager.mask[..., None], 2 * prediction.normals - 1, 0)
    return replace(
        true,
        imager=prediction.imager,
        positions=prediction.metres()[chosen],
        normals=normals[chosen],
        contact_offset_m=prediction.contact_offset_m,
    )


def disturbed(true: Scene) -> Scene:
    """Positions blurred inside the mask and displaced by smooth noise; normals as they are."""
    scale = true.imager.size[0] / SIZE
    mask = true.imager.mask
    white = np.random.default_rng(0).standard_normal(true.positions.shape)
    noise = gaussian_filter(white, (0, 0, NOISE_BLUR * scale, NOISE_BLUR * scale, 0))
    noise *= NOISE_M / noise.std()
    positions = blurred(true.positions, mask, BLUR * scale) + torch.from_numpy(noise).float()
    return replace(true, positions=torch.where(mask[..., None], positions, 0))


def with_outliers(true: Scene) -> Scene:
    """One covered pixel in ten displaced at random, far."""
    rng = np.random.default_rng(0)
    hit = (rng.random(true.positions.shape[:-1]) < OUTLIERS) & true.imager.mask.numpy()
    away = rng.normal(0, OUTLIER_M, true.positions.shape) * hit[..., None]
    return replace(true, positions=true.positions + torch.from_numpy(away.astype(np.float32)))


def with_sleeve_off(true: Scene) -> Scene:
    """The sleeve on the wearer's left displaced as a whole in both views, as if it had been decoded by another box."""
    template = torch.from_numpy(true.imager.mesh.vertices).float()
    sleeve = true.imager.operator(template)[..., 0] > SLEEVE * template[:, 0].max()
    off = torch.tensor([0.0, SLEEVE_M, 0.0])
    return replace(true, positions=true.positions + sleeve[..., None] * off)
