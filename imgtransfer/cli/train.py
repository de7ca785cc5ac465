"""`imgtransfer train`: train both transfer networks, or fit another method, from a YAML file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from imgtransfer.cli.options import add_changes, refuse_twice


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """The command's arguments."""
    parser = subparsers.add_parser(
        "train",
        help="train the transfer networks from a YAML file, or a method to compare them with",
        description="Writes model.safetensors, log.jsonl, config.yaml and the state to resume from. "
        "Ctrl-C or SIGTERM saves the state and stops. It is also saved every ten minutes. A file with a section "
        "`method` is of another method than the networks; docs/benchmark.md says which there are.",
        examples=(
            "imgtransfer train configs/demo.yaml --data my_data.zarr --set training.steps=20000 --out runs/mine",
            "imgtransfer train configs/methods/pose_regression.yaml --out runs/regression",
        ),
    )
    parser.add_argument("config", type=Path, help="the run's YAML, such as configs/demo.yaml")
    parser.add_argument("--data", type=Path, help="data set or folder of clip npz, in place of data.source")
    parser.add_argument(
        "--init",
        type=Path,
        metavar="MODEL",
        help="begin with the weights of a trained model, a run's folder or its model.safetensors, in place of "
        "training.init; maps and network (but for its head) must be the same, and the garment, unless the model was "
        "trained on several",
    )
    parser.add_argument("--out", type=Path, help="folder of the run (default: runs/NAME of the YAML file)")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the run in --out, to more steps if --set training.steps=N says so",
    )
    add_changes(parser, "training.steps=100, --set 'data.train.names=[tshirt/*]'")
    return parser


def run(args: argparse.Namespace) -> None:
    """Train, and say where the results are."""
    from imgtransfer.deformers.config import load_run_config  # noqa: PLC0415
    from imgtransfer.deformers.fit import fit_run  # noqa: PLC0415
    from imgtransfer.training.config import DataConfig, RunConfig  # noqa: PLC0415
    from imgtransfer.training.loop import CONFIG_FILE, LOG_FILE, train  # noqa: PLC0415
    from imgtransfer.training.processes import is_main  # noqa: PLC0415

    changes = list(args.set)
    paths = {"data": "data.source", "init": "training.init"}
    refuse_twice(args, {option: (key,) for option, key in paths.items()})
    for option, key in paths.items():
        if (path := getattr(args, option)) is not None:
            changes.append(f"{key}={json.dumps(str(path))}")  # whatever the path, a text to YAML
    config = load_run_config(args.config, changes)
    out = args.out or Path("runs") / args.config.stem
    if isinstance(config, RunConfig):
        model = train(config, out, resume=args.resume)
    else:
        model = fit_run(config, out, resume=args.resume)
    if not is_main():
        return
    print(f"model   {model}")
    if (out / LOG_FILE).exists():
        print(f"log     {out / LOG_FILE}")
    print(f"config  {out / CONFIG_FILE}")
    source = config.data.sources[0] if isinstance(config.data, DataConfig) else config.data.source
    print(f"next    imgtransfer predict {out} {source} --out {out / 'predicted'}")
