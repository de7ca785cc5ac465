"""The `imgtransfer` command: finds the subcommand, turns a user's mistake into one line."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from imgtransfer.cli.parser import Parser
from imgtransfer.running.exit import exit_status
from imgtransfer.running.waiting import wait_passively

# One module a command. Each has `add_parser(subparsers) -> ArgumentParser` and `run(args) -> None`, and
# imports what is heavy inside `run`, so that `--help` is instant.
COMMANDS = (
    "dress",
    "simulate",
    "train",
    "predict",
    "fuse",
    "evaluate",
    "benchmark",
    "ablate",
    "render",
    "inspect",
    "view",
    "export",
    "import_",
    "migrate",
    "config",
    "doctor",
    "completion",
)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; the parsed namespace has `run`, the function to call with it."""
    parser = Parser(
        prog="imgtransfer",
        description="Deform garments without skinning: body and garment as images, a network, a fusion.",
        examples=(
            "imgtransfer doctor",
            "imgtransfer inspect configs/sample_data/tshirt.zarr.zip",
        ),
    )
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for name in COMMANDS:
        module = importlib.import_module(f"imgtransfer.cli.{name}")
        module.add_parser(subparsers).set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; for the exit status see `exit_status`."""

    def command() -> None:
        args = build_parser().parse_args(argv)
        from render.threads import one_blas_thread  # noqa: PLC0415 (`--help` does not wait for SciPy)

        with one_blas_thread():
            args.run(args)

    wait_passively()
    return exit_status(command, program="imgtransfer", stopped="stopped")


if __name__ == "__main__":
    sys.exit(main())
