"""The `imgtransfer` command: finds the subcommand, turns a user's mistake into one line."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence

from imgtransfer.cli.parser import Parser
from imgtransfer.running.memory import shortage
from imgtransfer.running.stopping import Terminated, sigterm_as_interrupt
from imgtransfer.running.waiting import wait_passively
from render import InputError
from render.errors import one_line

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


def exit_status(run: Callable[[], object], *, program: str, stopped: str) -> int:
    """Call `run`, and turn what a user can mend into one line on stderr that starts with `program`.

    Returns:
        0 done, 2 input that the user can mend, or a machine that is too small for it; after saying `stopped`,
        130 for Ctrl-C and 143 for SIGTERM.
    """
    try:
        with sigterm_as_interrupt():
            run()
    except InputError as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as signal:
        print(f"{program}: {stopped}", file=sys.stderr)
        return 143 if isinstance(signal, Terminated) else 130
    except BrokenPipeError:  # `imgtransfer inspect ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (OSError, ValueError, MemoryError, RuntimeError) as error:
        reason = _of_the_machine(error)
        if reason is None:  # a fault of ours
            raise
        print(f"{program}: error: {reason}", file=sys.stderr)
        return 2
    return 0


def _of_the_machine(error: Exception) -> str | None:
    """What files or memory refused, on one line; None where the error is of another kind."""
    if isinstance(error, OSError):  # no permission, a full disk, a file where a folder is wanted
        return one_line(f"{error.filename or 'files'}: {error.strerror or error}")
    if isinstance(error, ValueError):
        of_a_path = "embedded null" in str(error)
        return "a path holds a null character, which no file's name has" if of_a_path else None
    return shortage(error)


if __name__ == "__main__":
    sys.exit(main())
