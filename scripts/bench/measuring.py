"""Timing of alternatives against each other in one run, and how the results are printed."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import torch
from tabulate import tabulate

Results = dict[str, dict[str, float]]  # section (column of the table) -> key (row) -> number
SAMPLE_SECONDS = 0.03  # a timing shorter than this is repeated until it fills the time


class Timings:
    """Seconds of each alternative in each round.

    Args:
        seconds: by name, one number a round; round k of all names happened together.
    """

    def __init__(self, seconds: Mapping[str, Sequence[float]]) -> None:
        self.seconds = seconds

    def s(self, name: str) -> float:
        """Median seconds of one call."""
        return median(self.seconds[name])

    def ms(self, name: str) -> float:
        """Median milliseconds of one call."""
        return 1000 * self.s(name)

    def ratio(self, name: str, to: str) -> float:
        """How many times as long `name` takes as `to`: the median of the rounds' own ratios."""
        return median(a / b for a, b in zip(self.seconds[name], self.seconds[to], strict=True))


def interleaved(
    alternatives: Mapping[str, Callable[[], object]], *, rounds: int, told: str | None = None
) -> Timings:
    """Time the alternatives one after another, round by round, so that other load on the machine meets all alike.

    Each is called once before, unmeasured: first calls compile, allocate and fill caches.

    Args:
        alternatives: by name, what to call.
        rounds: how often.
        told: what stderr is told of after each round; None: nothing.
    """
    calls = {}
    for name, call in alternatives.items():
        call()
        calls[name] = max(1, int(SAMPLE_SECONDS / _timed(call, 1))) if rounds > 1 else 1
    seconds: dict[str, list[float]] = {name: [] for name in alternatives}
    for number in range(rounds):
        for name, call in alternatives.items():
            seconds[name].append(_timed(call, calls[name]))
        if told is not None:
            last = ", ".join(f"{name} {taken[-1]:.3g} s" for name, taken in seconds.items())
            print(f"{told}, round {number + 1} of {rounds}: {last}", file=sys.stderr)
    return Timings(seconds)


def machine() -> dict[str, Any]:
    """CPU model, cores, versions, and how busy the machine was (mean number of running processes, one minute)."""
    return {
        "cpu": _cpu_model(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),
        "torch": torch.__version__,
        "python": platform.python_version(),
    }


def command(
    description: str | None, measure: Callable[[bool], Results], arguments: Sequence[str] | None = None
) -> None:
    """Run one bench as a command: its options, one torch thread, and a table or JSON on stdout.

    Args:
        description: for --help.
        measure: True for small sizes and single rounds -> results.
        arguments: the command line, sys.argv's if None.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of a table")
    parser.add_argument(
        "--quick", action="store_true", help="small sizes, one round: shows that it runs, not how fast"
    )
    options = parser.parse_args(arguments)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        found, results = machine(), measure(options.quick)
    finally:
        torch.set_num_threads(threads)
    if options.json:
        print(json.dumps({"machine": found, "quick": options.quick, **results}, indent=2))
        return
    print(", ".join(f"{key} {value}" for key, value in found.items()))
    keys = list(dict.fromkeys(key for section in results.values() for key in section))
    rows = [[key, *(section.get(key) for section in results.values())] for key in keys]
    print(tabulate(rows, headers=["", *results], floatfmt=".3g"))


def _timed(call: Callable[[], object], calls: int) -> float:
    """Seconds of one call, mean over `calls` of them."""
    started = time.perf_counter()
    for _ in range(calls):
        call()
    return (time.perf_counter() - started) / calls


def _cpu_model() -> str:
    """As the system names it; Linux does so in /proc/cpuinfo only."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
