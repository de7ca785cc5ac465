"""`imgtransfer simulate`: cloth simulation of motions into a data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from imgtransfer.cli.options import add_runner, chosen_executor
from render import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """The command's arguments."""
    parser = subparsers.add_parser(
        "simulate",
        help="simulate a garment on a body for a list of motions",
        description="Clips that the data set holds already are left as they are, so a stopped run goes on. Those that "
        "fail their quality gates are listed in the data set, and tried again only with other settings.",
    )
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="CONFIG_OR_MOTIONS",
        help="a YAML file such as configs/data/sample.yaml, and/or motion files (AMASS-style npz, BVH) or folders "
        "of them",
    )
    parser.add_argument("--out", type=Path, required=True, help="the data set, made where it does not exist")
    parser.add_argument("--frames", type=int, help="only the first FRAMES frames of each motion")
    add_runner(parser)
    return parser


def run(args: argparse.Namespace) -> None:
    """Simulate, and say where the data set is."""
    from imgtransfer.simulation.config import SimulateConfig, load_config  # noqa: PLC0415
    from imgtransfer.simulation.job import plan, simulate  # noqa: PLC0415

    executor = chosen_executor(args)
    configs = [path for path in args.sources if path.suffix in (".yaml", ".yml")]
    if len(configs) > 1:
        raise InputError(f"one configuration at a time, found {', '.join(str(path) for path in configs)}")
    config = load_config(configs[0]) if configs else SimulateConfig()
    tasks = plan(config, [path for path in args.sources if path not in configs], frames=args.frames)
    rejected = simulate(tasks, args.out, executor=executor)
    print(f"{len(tasks) - len(rejected)} of {len(tasks)} clips stand, {len(rejected)} rejected")
    for name, reason in rejected.items():
        print(f"  {name}: {reason}")
    print(f"data set {args.out}")
    print(f"next     imgtransfer inspect {args.out}")
