"""`imgtransfer benchmark`: train and measure methods on the same clips."""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import nullcontext, redirect_stdout
from pathlib import Path

from imgtransfer.cli.options import add_changes, add_runner, chosen_executor
from render import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "benchmark",
        help="train and measure methods on the same clips",
        description="Trains what is not trained yet, each method in a run folder of its own, measures it on the test "
        "clips, and writes results.json, tables.md, tables.tex, pictures and report.html. The same command goes on "
        "with what was stopped.",
        examples=(
            "imgtransfer benchmark configs/benchmark/sample.yaml --workers 2 --out runs/sample",
            "imgtransfer benchmark configs/benchmark/sample.yaml --methods lbs --predictions mine=clips",
        ),
    )
    parser.add_argument(
        "config", type=Path, help="the benchmark's YAML, such as configs/benchmark/sample.yaml"
    )
    parser.add_argument("--methods", help="only these of the file, separated by commas; by label, which is their name "
                        "where they have none")  # fmt: skip
    parser.add_argument(
        "--data", type=Path, help="data set or folder of clip npz, in place of every data.source"
    )
    parser.add_argument(
        "--predictions",
        action="append",
        default=[],
        metavar="NAME=FOLDER",
        help="also measure clips that another program has predicted, as CLIP.npz with garment_vertices, or in folders "
        "as predict and fuse write them; may be given again",
    )
    parser.add_argument("--out", type=Path, help="folder of everything (default: runs/NAME of the YAML file)")
    add_changes(parser, "fuse=false")
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    add_runner(parser)
    return parser


def run(args: argparse.Namespace) -> None:
    """Run the benchmark, and print its tables."""
    from imgtransfer.benchmark.config import BenchmarkConfig  # noqa: PLC0415
    from imgtransfer.benchmark.mode_tables import mode_tables  # noqa: PLC0415
    from imgtransfer.benchmark.run import PAGE_FILE, run_benchmark  # noqa: PLC0415
    from imgtransfer.benchmark.tables import overall_table  # noqa: PLC0415
    from imgtransfer.config.loader import load_config  # noqa: PLC0415

    executor = chosen_executor(args)
    config = load_config(BenchmarkConfig, args.config, args.set)
    if args.data is not None:
        sources = [data.model_copy(update={"source": args.data}) for data in config.data]
        config = config.model_copy(update={"data": tuple(sources)})
    out = args.out or Path("runs") / args.config.stem
    with redirect_stdout(sys.stderr) if args.json else nullcontext():
        results = run_benchmark(
            config,
            out.resolve() if args.ray else out,
            executor=executor,
            source=str(args.config),
            only=None if args.methods is None else args.methods.split(","),
            predictions=_predictions(args.predictions),
        )
    if args.json:
        print(json.dumps(results, indent=1))
        return
    for data in config.data:
        print(f"\n{data.name}\n{overall_table(results, data.name)}")
        for title, table in mode_tables(results, data.name):
            print(f"\n{data.name}: {title}\n{table}")
    print(f"\npage     {out / PAGE_FILE}")


def _predictions(given: list[str]) -> dict[str, Path]:
    """By name, the folder of each --predictions."""
    folders: dict[str, Path] = {}
    for one in given:
        name, equals, folder = one.partition("=")
        if not equals or not name or not folder or name in folders:
            raise InputError(
                f"--predictions {one}: NAME=FOLDER is wanted, each name once, such as mine=predictions"
            )
        folders[name] = Path(folder)
    return folders
