"""Command-line arguments that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from reprlib import repr as shortened
from typing import TYPE_CHECKING

from render import InputError

if TYPE_CHECKING:  # `--help` must not wait for the array libraries
    from imgtransfer.data.source import ClipRef
    from imgtransfer.running import Executor

_DIGITS = 9  # of a number that somebody means


def add_clip_choice(parser: argparse.ArgumentParser) -> None:
    """Add --split and --clip, which choose among the clips of a source."""
    parser.add_argument("--split", help="only the clips of this split (data sets only)")
    add_clip_names(parser)


def add_clip_names(parser: argparse.ArgumentParser) -> None:
    """Add --clip, which chooses by name."""
    parser.add_argument(
        "--clip",
        action="append",
        metavar="GLOB",
        help="only clips whose name matches, such as 'dress/*'; may be given again",
    )


def add_dry_run(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --dry-run, which says `what` and stops."""
    parser.add_argument(
        "--dry-run", action="store_true", help=f"read and check the files, say {what} and how, and stop"
    )


def add_changes(parser: argparse.ArgumentParser, example: str) -> None:
    """Add --set, which changes values of the command's configuration (`imgtransfer.config.loader.with_changes`)."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"change a value of the configuration, or of the defaults: --set {example}; may be given again",
    )


def refuse_twice(args: argparse.Namespace, said: Mapping[str, Sequence[str]]) -> None:
    """Raise InputError where --set changes what an option says already, so that one of the two would do nothing.

    Args:
        said: the keys of the configuration that each option decides, by the option's name in `args`.
    """
    changed = {change: change.partition("=")[0].strip() for change in args.set}
    for option, keys in said.items():
        for change, key in changed.items():
            twice = any(f"{key}.".startswith(f"{one}.") for one in keys)
            if twice and getattr(args, option) not in (None, False):
                raise InputError(
                    f"--{option.replace('_', '-')} decides what --set {change} would change; give one of them"
                )


def add_runner(parser: argparse.ArgumentParser) -> None:
    """Add --workers and --ray, which say where the work on many clips is done."""
    group = parser.add_argument_group("many clips")
    group.add_argument("--workers", type=int, default=1, help="processes on this machine; default 1")
    group.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="a Ray cluster in place of processes: HOST:PORT, or auto for the one that this machine belongs to; "
        "all machines must see the files at the same path or URL",
    )


def chosen_executor(args: argparse.Namespace) -> Executor:
    """Where --workers and --ray put the work."""
    from imgtransfer.running import executor_for  # noqa: PLC0415

    return executor_for(workers=args.workers, ray=args.ray)


def add_views(
    parser: argparse.ArgumentParser, *, default: str | None = "front,back", note: str = "default front,back"
) -> None:
    """Add --views (checked where it is used, by `render.parse_views`) and --layers; `note` says the default."""
    parser.add_argument(
        "--views",
        default=default,
        help="front, back, left, right, AZIMUTH/ELEVATION in degrees such as 45/20, separated by commas; or four, "
        f"or ring:N; {note}",
    )
    parser.add_argument("--layers", type=number_of_layers, help="how many surfaces deep each view is imaged")


def at_least_one(text: str) -> int:
    """A whole number from 1 on, for argparse's `type`."""
    number = whole_number(text)
    if number is None or number < 1:
        raise argparse.ArgumentTypeError(f"a whole number from 1 on is wanted, found {shortened(text)}")
    return number


def number_of_layers(text: str) -> int:
    """At most `MAX_LAYERS`, for argparse's `type`."""
    from render.limits import MAX_LAYERS  # noqa: PLC0415

    number = at_least_one(text)
    if number > MAX_LAYERS:
        raise argparse.ArgumentTypeError(f"1 to {MAX_LAYERS} layers are wanted, found {number}")
    return number


def whole_number(text: str) -> int | None:
    """Digits as a number; None for anything else, such as ², ٣ and 1_0, which Python's `int` or `isdigit` may take."""
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= _DIGITS else None


def chosen_refs(args: argparse.Namespace, source: str | Path) -> list[ClipRef]:
    """The clips of `source` that --split and --clip choose, not read yet."""
    from imgtransfer.data.source import clip_refs  # noqa: PLC0415

    return clip_refs(source, split=args.split, names=args.clip)


def image_size(text: str) -> tuple[int, int]:
    """ "256" or "HxW" -> (height, width)."""
    from render.limits import MAX_LENGTH  # noqa: PLC0415

    parts = text.lower().split("x")
    lengths = [whole_number(part) or 0 for part in parts]
    if len(parts) > 2 or not all(1 <= length <= MAX_LENGTH for length in lengths):
        raise InputError(
            f"--size {text}: a number of pixels is wanted, such as 256, or HEIGHTxWIDTH; "
            f"at most {MAX_LENGTH} pixels a side"
        )
    return lengths[0], lengths[-1]


def frame_slice(text: str) -> slice:
    """ "START:STOP:STEP", each part optional, or one frame number -> slice."""
    try:
        if len(text) > 3 * _DIGITS + 5 or not text.isascii():
            raise ValueError
        parts = [int(part) if part else None for part in text.split(":")]
        if len(parts) == 1 and parts[0] is not None:
            return slice(parts[0], parts[0] + 1 or None)
        if 2 <= len(parts) <= 3 and (len(parts) < 3 or parts[2] is None or parts[2] > 0):
            return slice(*parts)
    except ValueError:
        pass
    raise InputError(f"--frames {text}: wanted is a frame number or START:STOP:STEP, such as 0:60:10")
