"""Runs bad inputs by hand: `python tests/bad_inputs fuse-maps-npz-bit-flip 'train-*'`."""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from fnmatch import fnmatch
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parents[2])

from tests.bad_inputs.cases import SEED, cases, ordinary  # noqa: E402 - after the path is set
from tests.bad_inputs.good import write_good  # noqa: E402
from tests.bad_inputs.supervisor import Supervisor  # noqa: E402
from tests.bad_inputs.verdict import faults  # noqa: E402


def main() -> int:
    """Run the chosen cases and tell about each; status 1 where one is answered wrongly."""
    parser = argparse.ArgumentParser(prog="python tests/bad_inputs", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="names of cases, or patterns in quotes")
    parser.add_argument("--list", action="store_true", help="print the names only")
    parser.add_argument("--ordinary", action="store_true", help="those of the ordinary run")
    parser.add_argument("--folder", type=Path, help="where the inputs stay; default a temporary folder")
    parser.add_argument("--some", type=int, metavar="N", help="N of them, drawn at random")
    parser.add_argument("--part", metavar="K/N", default="0/1", help="every N-th case from the K-th on")
    parser.add_argument("--verbose", action="store_true", help="also print what the commands print")
    args = parser.parse_args()
    chosen = ordinary() if args.ordinary else list(cases())
    if args.names:
        chosen = list(dict.fromkeys(name for given in args.names for name in chosen if fnmatch(name, given)))
    first, step = map(int, args.part.split("/"))
    if args.some:
        chosen = random.Random(SEED).sample(chosen, min(args.some, len(chosen)))
    chosen = chosen[first::step]
    if args.list:
        print("\n".join(chosen))
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        good = folder / "good"
        if not good.exists():
            good.mkdir(parents=True)
            write_good(good)
        return _run(chosen, good, folder / f"cases{first}", verbose=args.verbose)


def _run(names: list[str], good: Path, scratch: Path, *, verbose: bool) -> int:
    wrong = 0
    with Supervisor(good, scratch) as supervisor:
        for name in names:
            answer = supervisor.run(cases()[name])
            found = faults(cases()[name], answer)
            wrong += bool(found)
            print(f"{'WRONG' if found else 'right'}  {name}  {answer.seconds:.1f} s", flush=True)
            for fault in found:
                print(f"       {fault}")
            if verbose:
                print(answer.out + answer.err)
    print(f"{wrong} of {len(names)} answered wrongly")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
