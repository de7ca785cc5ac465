"""`imgtransfer migrate`: a data set of an older schema version to the current one."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "migrate",
        help="bring a data set to the current schema version",
        description="Rewrites the data set in place, clip by clip; a stopped run goes on where it was. Older versions "
        "can be read without this, but nothing can be added to them.",
        examples=(
            "imgtransfer migrate old.zarr",
            "imgtransfer migrate s3://bucket/old.zarr",
        ),
    )
    parser.add_argument("data", type=Path, help="the data set, folder or URL")
    return parser


def run(args: argparse.Namespace) -> None:
    """Rewrite the clips, and say what was done."""
    from tqdm import tqdm  # noqa: PLC0415

    from imgtransfer.data.migration import migrate  # noqa: PLC0415
    from imgtransfer.data.schema import SCHEMA_VERSION  # noqa: PLC0415

    rewritten, before = migrate(args.data, lambda names: tqdm(names, unit="clip", disable=None))
    if before == SCHEMA_VERSION:
        print(f"{args.data} has schema version {before} already")
    else:
        print(f"{args.data}: schema version {before} -> {SCHEMA_VERSION}, {len(rewritten)} clips rewritten")
    print(f"next     imgtransfer inspect {args.data}")
