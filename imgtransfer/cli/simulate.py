"""`imgtransfer simulate`: cloth simulation of motions into a data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from render import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """The command's arguments."""
    parser = subparsers.add_parser(
        "simulate",
        help="simulate a T-shirt on the Anny body for a list of motions",
        description="Clips that the data set holds already are left as they are, so a stopped run goes on.",
    )
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="CONFIG_OR_MOTIONS",
        help="a YAML file such as configs/data/sample.yaml, and/or AMASS-style npz files or folders of them",
    )
    parser.add_argument("--out", type=Path, required=True, help="the data set, made where it does not exist")
    parser.add_argument("--workers", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--frames", type=int, help="only the first FRAMES frames of each motion")
    return parser


def run(args: argparse.Namespace) -> None:
    """Simulate, and say where the data set is."""
    from imgtransfer.simulation.config import SimulateConfig, load_config  # noqa: PLC0415
    from imgtransfer.simulation.job import plan, simulate  # noqa: PLC0415

    if args.workers < 1:
        raise InputError(f"--workers {args.workers}: a whole number from 1 is wanted")
    configs = [path for path in args.sources if path.suffix in (".yaml", ".yml")]
    if len(configs) > 1:
        raise InputError(f"one configuration at a time, found {', '.join(str(path) for path in configs)}")
    config = load_config(configs[0]) if configs else SimulateConfig()
    tasks = plan(config, [path for path in args.sources if path not in configs], frames=args.frames)
    reasons = simulate(tasks, args.out, workers=args.workers)
    print(f"{len(tasks) - len(reasons)} of {len(tasks)} clips stand, {len(reasons)} rejected")
    print(f"data set {args.out}")
    print(f"next     imgtransfer inspect {args.out}")
