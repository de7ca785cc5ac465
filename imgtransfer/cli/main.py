"""The `imgtransfer` command: finds the subcommand, turns a user's mistake into one line."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence

from imgtransfer.cli.parser import Parser
from imgtransfer.waiting import wait_passively
from render import InputError

# One module a command. Each has `add_parser(subparsers) -> ArgumentParser` and `run(args) -> None`, and
# imports what is heavy inside `run`, so that `--help` is instant.
COMMANDS = (
    "simulate",
    "train",
    "predict",
    "fuse",
    "evaluate",
    "render",
    "inspect",
    "export",
    "import_",
    "migrate",
    "doctor",
)


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; the parsed namespace has `run`, the function to call with it."""
    parser = Parser(
        prog="imgtransfer",
        description="Deform garments without skinning: body and garment as images, a network, a fusion.",
        examples=(
            "imgtransfer doctor",
            "imgtransfer inspect configs/sample_data/tshirt.zarr",
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
        args.run(args)

    wait_passively()
    return exit_status(command, program="imgtransfer", stopped="stopped")


def exit_status(run: Callable[[], object], *, program: str, stopped: str) -> int:
    """Call `run`, and turn what a user can mend into one line on stderr that starts with `program`.

    Returns:
        0 done, 2 input that the user can mend, 130 Ctrl-C (after saying `stopped`).
    """
    try:
        run()
    except InputError as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{program}: {stopped}", file=sys.stderr)
        return 130
    except BrokenPipeError:  # `imgtransfer inspect ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ValueError as error:
        if "null" not in str(error):  # of a path; all else is a fault of ours
            raise
        print(f"{program}: error: a path holds a null character, which no file's name has", file=sys.stderr)
        return 2
    except OSError as error:  # no permission, a full disk, a file where a folder is wanted
        print(f"{program}: error: {error.filename or 'files'}: {error.strerror or error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
