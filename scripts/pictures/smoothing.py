"""What `imgtransfer fuse --smooth-time` does to a clip with noise that is new in every frame: a table and a picture.

    python scripts/pictures/smoothing.py [--data configs/sample_data/tshirt.zarr.zip] [--clip tshirt/punch_s101]
        [--seconds 0.15] [--out docs/images/fusion_smoothing.png]

The truth's maps (128 x 128, front and back) get noise of each frame by itself: 4 mm and 0.08 of a normal's components,
both smooth over 3 pixels, and 1 mm from pixel to pixel.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from tabulate import tabulate

from fusion import DecodedMaps, FusionConfig, FusionInputs, MovingSurface, fuse
from fusion.smoothing import smoothed_paths
from imgtransfer.data import Clip, DataSet, root_frames
from imgtransfer.report.pictures import curve_picture
from render import Mesh, TemplateImager, write_png

SIZE, SEED = (128, 128), 5
SMOOTH_NOISE_M, PIXEL_NOISE_M, NORMAL_NOISE, NOISE_PIXELS = 0.004, 0.001, 0.08, 3.0


def noisy_inputs(clip: Clip, truth: np.ndarray, body: np.ndarray, imager: TemplateImager) -> FusionInputs:
    """The truth's maps with noise, and the body, in the canonical frame."""
    random = np.random.default_rng(SEED)
    vertices, mask = torch.from_numpy(truth), imager.mask.numpy()[..., None]
    positions, normals = imager.operator(vertices).numpy(), 2 * imager.normal_maps(vertices).numpy() - 1

    def smooth(deviation: float) -> np.ndarray:
        noise = gaussian_filter(random.normal(size=positions.shape), (0, 0, NOISE_PIXELS, NOISE_PIXELS, 0))
        return deviation * noise / noise.std()

    positions = positions + smooth(SMOOTH_NOISE_M) + random.normal(0, PIXEL_NOISE_M, positions.shape)
    maps = DecodedMaps(positions * mask, (normals + smooth(NORMAL_NOISE)) * mask)
    return FusionInputs(maps=maps, body=MovingSurface(body, clip.body.faces), fps=clip.fps)


def spectrum(vertices: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz, and the root mean square amplitude of the vertices' accelerations at each, m/s²."""
    acceleration = np.diff(vertices.astype(np.float64), n=2, axis=0) * fps**2
    window = np.hanning(len(acceleration))[:, None, None]
    amplitude = np.abs(np.fft.rfft(window * acceleration, axis=0)) / window.sum()
    return np.fft.rfftfreq(len(acceleration), 1 / fps), np.sqrt(np.square(amplitude).sum(-1).mean(-1))


def main() -> None:
    """Fuse without and with smoothing, print the table, draw the spectra."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path("configs/sample_data/tshirt.zarr.zip"))
    parser.add_argument("--clip", default="tshirt/punch_s101")
    parser.add_argument(
        "--seconds", type=float, nargs="+", default=[0.1, 0.15, 0.2], help="the second is drawn"
    )
    parser.add_argument("--out", type=Path, default=Path("docs/images/fusion_smoothing.png"))
    args = parser.parse_args()
    clip = DataSet.open(args.data).reader(args.clip).clip()
    frames = root_frames(clip, "root")
    truth, body = frames.to_canonical(clip.garment.vertices), frames.to_canonical(clip.body.vertices)
    imager = TemplateImager.build(Mesh(clip.template.vertices, clip.template.faces, clip.name), size=SIZE)
    inputs = noisy_inputs(clip, truth, body, imager)

    def accelerations(vertices: np.ndarray) -> float:
        return float(
            np.linalg.norm(np.diff(vertices.astype(np.float64), n=2, axis=0), axis=-1).mean() * clip.fps**2
        )

    def error_mm(vertices: np.ndarray) -> float:
        return float(1000 * np.linalg.norm(vertices - truth, axis=-1).mean())

    rows = [["truth", accelerations(truth), 0.0, None]]
    curves = {"truth": spectrum(truth, clip.fps)}
    drawn = args.seconds[min(1, len(args.seconds) - 1)]
    for seconds in (0.0, *args.seconds):
        result = fuse(imager, inputs, FusionConfig(smooth_time_s=seconds))
        name = f"--smooth-time {seconds:g}" if seconds else "without"
        damped = error_mm(smoothed_paths(truth, seconds * clip.fps)) if seconds else 0.0
        rows.append([name, accelerations(result.vertices), error_mm(result.vertices), damped])
        if seconds in (0.0, drawn):
            curves[name] = spectrum(result.vertices, clip.fps)
    print(
        tabulate(
            rows,
            ["", "acceleration (m/s²)", "RMSE (mm)", "of the truth itself (mm)"],
            "github",
            floatfmt=".2f",
        )
    )
    picture = curve_picture(
        {name: (x.tolist(), y.tolist()) for name, (x, y) in curves.items()},
        title=f"{args.clip} with noise in every frame",
        x_label="Hz",
        y_label="acceleration, m/s²",
    )
    write_png(args.out, picture)


if __name__ == "__main__":
    main()
