#!/usr/bin/env python
"""What each term of the fusion is worth: Table 5 of the paper, on predictions of `imgtransfer predict`.

    imgtransfer predict configs/pretrained configs/sample_data/tshirt.zarr.zip --split test --out predictions
    scripts/bench/fusion_terms.py predictions --truth configs/sample_data/tshirt.zarr.zip

Prints, by solver, the distance to the truth of the vertices as the maps give them, after the edge stage, with the
rendered normals, and in full (normal consistency and the body added). docs/results.md holds the outcome. With
--true-normals the predicted normal maps are replaced by those of the truth: what the term can do, the prediction's
errors aside.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch
from tabulate import tabulate

# This folder's own fusion.py and render.py must not hide the packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fusion import FusionConfig
from imgtransfer.ablation.fusion_terms import TERMS, fused_with
from imgtransfer.config.loader import load_config
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import open_clips
from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames
from imgtransfer.pipeline.folder import MAPS_FILE, clip_of_folder, predicted_clips
from render import InputError, MapFile, load_maps

SOLVERS = ("local_global", "adam")
# Rows that add to the line before.
_SHOWN = {"edge lengths": "+ edge lengths", "rendered normals": "+ rendered normals"}
COLUMNS = {
    "rmse_mm": "RMSE (mm)",
    "hausdorff_mm": "Hausdorff (mm)",
    "sted": "STED",
    "sted_spatial": "STED spatial",
    "sted_temporal": "STED temporal",
    "penetration_percent": "inside body (%)",
    "crossing_percent": "crossing body (%)",
}


def with_true_normals(maps: MapFile, truth: Clip) -> MapFile:
    """The same predicted positions with normal maps of the truth."""
    assert truth.garment is not None
    imager = maps.imager()
    canonical = RootFrames(maps.rotation, maps.translation).to_canonical(truth.garment.vertices)
    return replace(maps, normal=imager.normal_maps(torch.from_numpy(canonical)).numpy())


def measure(
    predictions: Path, truth: Path, *, config: FusionConfig | None = None, true_normals: bool = False
) -> dict[str, dict[str, dict[str, float]]]:
    """Means over all frames of all predicted clips: solver -> row -> metric."""
    predicted = {
        clip_of_folder(folder.resolve().name): load_maps(folder / MAPS_FILE)
        for folder in predicted_clips(predictions)
    }
    truths = {clip.name: clip for clip in open_clips(truth, names=list(predicted))}
    for clip in truths.values():
        if clip.garment is None:
            raise InputError(f"{truth}: clip {clip.name} has no garment vertices to compare with")
    if true_normals:
        predicted = {name: with_true_normals(maps, truths[name]) for name, maps in predicted.items()}
    given = (config or FusionConfig()).model_dump()
    found: dict[str, dict[str, dict[str, float]]] = {}
    for solver in SOLVERS:
        found[solver] = {}
        settings = FusionConfig.model_validate(given | {"solver": solver})
        for row in TERMS:
            values = []
            for name, maps in predicted.items():
                clip = truths[name]
                assert clip.garment is not None
                vertices = fused_with(maps, clip, row, settings)
                metrics = evaluate_clip(
                    vertices, clip.garment.vertices, clip.template.faces, clip.body.vertices, clip.body.faces
                )
                values.append((metrics, clip.n_frames))
            overall = mean_over_frames(values)
            found[solver][_SHOWN.get(row, row)] = {key: float(overall[key]) for key in COLUMNS}
    return found


def table(found: Mapping[str, Mapping[str, Mapping[str, float]]]) -> str:
    """As docs/results.md has it."""
    rows = [
        [solver, row, *(values[key] for key in COLUMNS)]
        for solver, by_row in found.items()
        for row, values in by_row.items()
    ]
    headers = ["solver", "terms", *COLUMNS.values()]
    return tabulate(
        rows,
        headers=headers,
        tablefmt="github",
        floatfmt=("", "", *(".2f",) * 2, *(".4f",) * 3, *(".3f",) * 2),
    )


def command() -> None:
    """Parse the command line, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("predictions", type=Path, help="what `imgtransfer predict` wrote")
    parser.add_argument("--truth", type=Path, required=True, help="data set, clip npz or folder of clip npz")
    parser.add_argument("--config", type=Path, help="YAML with the fusion's hyper-parameters that differ")
    parser.add_argument(
        "--true-normals", action="store_true", help="normal maps of the truth in place of the predicted ones"
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of a table")
    args = parser.parse_args()
    config = load_config(FusionConfig, args.config) if args.config else None
    found = measure(args.predictions, args.truth, config=config, true_normals=args.true_normals)
    print(json.dumps(found, indent=2) if args.json else table(found))


if __name__ == "__main__":
    from imgtransfer.running.exit import exit_status

    raise SystemExit(exit_status(command, program="fusion_terms", stopped="stopped"))
