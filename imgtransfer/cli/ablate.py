"""`imgtransfer ablate`: what each part of the method is worth, as the paper's tables 3, 4, 5 and 7."""

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
        "ablate",
        help="train and measure the rows of an ablation at one budget",
        description="Trains every row of the given tables with every seed, each once even where several tables have "
        "it, measures them on the test clips, and writes results.json and tables.md. The same command goes on with "
        "what was stopped. configs/ablation has the paper's tables: skinning (3), modules (4), fusion (5), inputs (7).",
        examples=(
            "imgtransfer ablate configs/ablation/skinning.yaml --out runs/skinning",
            "imgtransfer ablate configs/ablation/*.yaml --set method.training.steps=2000 --workers 2",
        ),
    )
    parser.add_argument("configs", type=Path, nargs="+", help="YAML files, a table each")
    parser.add_argument("--data", type=Path, help="data set or folder of clip npz, in place of data.source")
    parser.add_argument(
        "--out", type=Path, default=Path("runs/ablation"), help="folder of everything; default %(default)s"
    )
    add_changes(parser, "method.training.steps=2000")
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    add_runner(parser)
    return parser


def run(args: argparse.Namespace) -> None:
    """Run the ablations, and print their tables."""
    from imgtransfer.ablation.config import AblationConfig  # noqa: PLC0415
    from imgtransfer.ablation.run import MARKDOWN_FILE, run_ablations  # noqa: PLC0415
    from imgtransfer.ablation.table import ablation_table  # noqa: PLC0415
    from imgtransfer.config.loader import load_config  # noqa: PLC0415

    executor = chosen_executor(args)
    configs = {}
    for path in args.configs:
        if path.stem in configs:
            raise InputError(f"{path}: two tables are called {path.stem}; give one file another name")
        config = load_config(AblationConfig, path, args.set)
        if args.data is not None:
            config = config.model_copy(update={"data": config.data.model_copy(update={"source": args.data})})
        configs[path.stem] = config
    out = args.out.resolve() if args.ray else args.out
    with redirect_stdout(sys.stderr) if args.json else nullcontext():
        results = run_ablations(configs, out, executor=executor)
    if args.json:
        print(json.dumps(results, indent=1))
        return
    for name, table in results["tables"].items():
        print(f"\n{name}\n{ablation_table(table)}")
    print(f"\ntables   {args.out / MARKDOWN_FILE}")
