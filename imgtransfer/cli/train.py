"""`imgtransfer train`: train both transfer networks from a YAML file."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """The command's arguments."""
    parser = subparsers.add_parser(
        "train",
        help="train the transfer networks from a YAML file",
        description="Writes model.safetensors, log.jsonl, config.yaml and the state to resume from. "
        "Ctrl-C or SIGTERM saves the state and stops. It is also saved every ten minutes.",
    )
    parser.add_argument("config", type=Path, help="the run's YAML, such as configs/demo.yaml")
    parser.add_argument("--data", type=Path, help="data set or folder of clip npz, in place of data.source")
    parser.add_argument("--out", type=Path, help="folder of the run (default: runs/NAME of the YAML file)")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the run in --out, to more steps if --set training.steps=N says so",
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a value: training.steps=100"
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Train, and say where the results are."""
    from imgtransfer.training.config import load_config  # noqa: PLC0415
    from imgtransfer.training.loop import CONFIG_FILE, LOG_FILE, train  # noqa: PLC0415

    changes = list(args.set)
    if args.data is not None:
        changes.append(f"data.source={args.data}")
    config = load_config(args.config, changes)
    out = args.out or Path("runs") / args.config.stem
    model = train(config, out, resume=args.resume)
    print(f"model   {model}")
    print(f"log     {out / LOG_FILE}")
    print(f"config  {out / CONFIG_FILE}")
    print(f"next    imgtransfer predict {out} {config.data.source} --out {out / 'predicted'}")
