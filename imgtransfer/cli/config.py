"""`imgtransfer config`: every key of a command's configuration, as YAML that the command reads."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.cli.options import add_changes

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from pydantic import BaseModel

COMMANDS = ("train", "simulate", "fuse", "evaluate", "benchmark", "ablate")  # those that take a configuration


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "config",
        help="print every key of a configuration with unit, default and range",
        description="Prints the configuration of a command as YAML with a comment on every key: what it means, its "
        "type and range, its unit. All defaults stand in it, so it can be written to a file, changed and given to "
        "the command. Keys that have no default are comments, and so are other kinds of garment and body, and the "
        "methods that can be trained in place of the networks. With FILE or --set it shows the values that the "
        "command would take, the defaults too.",
        examples=(
            "imgtransfer config fuse > fusion.yaml",
            "imgtransfer config train configs/demo.yaml --set training.steps=1000",
        ),
    )
    parser.add_argument("command", choices=COMMANDS, help="the command that reads the configuration")
    parser.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="a configuration, to show all its values"
    )
    add_changes(parser, "weight_edge=50")
    return parser


def run(args: argparse.Namespace) -> None:
    """Print the schema, or the configuration that FILE and --set make."""
    from imgtransfer.config.commented import commented_yaml  # noqa: PLC0415
    from imgtransfer.config.loader import load_config  # noqa: PLC0415

    if args.file is None and not args.set:
        print(commented_yaml(schema_of(args.command)), end="")
        if args.command == "train":
            print(_methods(), end="")
        return
    if args.command == "train":
        from imgtransfer.deformers.config import load_run_config  # noqa: PLC0415

        config: BaseModel = load_run_config(args.file, args.set)
    else:
        config = load_config(schema_of(args.command), args.file, args.set)
    print(commented_yaml(type(config), config), end="")


def _methods() -> str:
    """Every method that a training's file can name in place of the networks, as comments."""
    from imgtransfer.config.commented import commented_yaml  # noqa: PLC0415
    from imgtransfer.deformers.config import method_section  # noqa: PLC0415
    from imgtransfer.deformers.registry import NETWORK, deformer_names  # noqa: PLC0415

    lines = [
        "",
        "In place of maps, network and training, with seed and threads at the top beside data and method:",
    ]
    for name in deformer_names():
        if name != NETWORK:  # its sections stand above
            text = commented_yaml(method_section(name))
            lines += ["", "method:", *(f"  {line}".rstrip() for line in text.splitlines())]
    return "".join(f"{f'# {line}'.rstrip()}\n" for line in lines)


def schema_of(command: str) -> type[BaseModel]:
    """What a command's configuration must be."""
    if command == "train":
        from imgtransfer.training.config import RunConfig  # noqa: PLC0415

        return RunConfig
    if command == "simulate":
        from imgtransfer.simulation.config import SimulateConfig  # noqa: PLC0415

        return SimulateConfig
    if command == "evaluate":
        from imgtransfer.evaluation.config import EvaluateConfig  # noqa: PLC0415

        return EvaluateConfig
    if command == "ablate":
        from imgtransfer.ablation.config import AblationConfig  # noqa: PLC0415

        return AblationConfig
    if command == "benchmark":
        from imgtransfer.benchmark.config import BenchmarkConfig  # noqa: PLC0415

        return BenchmarkConfig
    from fusion import FusionConfig  # noqa: PLC0415

    return FusionConfig
