"""What `scripts/demo` runs: `python -m imgtransfer.demo`, the whole method on the sample data."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from imgtransfer.running.exit import exit_status
from imgtransfer.running.waiting import wait_passively


def main() -> int:
    """Entry point of `scripts/demo`. Exit status as for `imgtransfer`."""
    wait_passively()  # before anything loads PyTorch
    parser = argparse.ArgumentParser(prog="scripts/demo", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument(
        "--garment",
        choices=("tshirt", "dress", "trousers", "skirt"),
        default="tshirt",
        help="which garment of the sample data (default: %(default)s)",
    )
    parser.add_argument(
        "--steps", type=int, help="train for so many steps; default those of the configuration"
    )
    parser.add_argument("--minutes", type=float, help="train for about so many minutes")
    args = parser.parse_args()
    return exit_status(
        lambda: _demo(args), program="demo", stopped="stopped; the same command goes on with the training"
    )


def _demo(args: argparse.Namespace) -> None:
    from imgtransfer.config.loader import load_config  # noqa: PLC0415
    from imgtransfer.demo.run import CHECKPOINT, DEMO_CONFIG, GENERAL, SAMPLE_DATA, run_demo  # noqa: PLC0415
    from imgtransfer.demo.training import Length  # noqa: PLC0415
    from imgtransfer.evaluation.table import metrics_table  # noqa: PLC0415
    from imgtransfer.training.config import RunConfig  # noqa: PLC0415

    config = load_config(
        RunConfig, DEMO_CONFIG, [f"data.source={json.dumps(str(SAMPLE_DATA[args.garment]))}"]
    )
    out: Path = args.out
    checkpoint = CHECKPOINT if args.garment == "tshirt" else GENERAL
    metrics = run_demo(out, config, checkpoint, Length(steps=args.steps, minutes=args.minutes))
    print(f"\n{metrics_table(metrics, first='method')}\n")
    animations, pictures = sorted(out.glob("*.glb")), sorted(out.glob("*.png"))
    files = [out / name for name in ("report.html", "metrics.json", "metrics_by_clip.json")]
    for path in [*files, *animations, out / "run", *pictures]:
        print(path)


if __name__ == "__main__":
    sys.exit(main())
