"""What is said of this machine, part by part, and what its processor does well, for `imgtransfer doctor`."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from pathlib import Path

from imgtransfer.running.waiting import waiting_in_words

CPU_INFO = Path("/proc/cpuinfo")
UNITS = {  # flag of /proc/cpuinfo -> what people call it
    "avx2": "AVX2",
    "avx512f": "AVX-512",
    "avx512_bf16": "AVX-512 BF16",
    "avx10": "AVX10",
    "amx_bf16": "AMX BF16",
    "asimd": "NEON",
    "sve": "SVE",
    "bf16": "ARM BF16",
}


@dataclass(frozen=True)
class Part:
    """What was found out about one part of the machine.

    Args:
        lines: names and what they are, in order.
        problem: what without it nothing works for, and what to do; None where it works.
    """

    lines: tuple[tuple[str, str], ...]
    problem: str | None = None


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def vector_units() -> str:
    """Those that the processor says it has, and which PyTorch uses."""
    import torch  # noqa: PLC0415

    flags = _cpu_flags()
    units = [name for flag, name in UNITS.items() if flag in flags]
    if not flags and platform.machine().lower() in ("arm64", "aarch64"):
        units = ["NEON"]  # every 64-bit ARM has it; only Linux lists flags
    return f"{', '.join(units) or 'none known'}; torch uses {torch.backends.cpu.get_cpu_capability()}"


def threads() -> str:
    """How many threads each numerical library takes, and how they wait."""
    import torch  # noqa: PLC0415
    from threadpoolctl import threadpool_info  # noqa: PLC0415

    counts = {"torch": torch.get_num_threads()}
    for pool in threadpool_info():
        if pool["user_api"] == "blas":
            counts[pool["internal_api"]] = pool["num_threads"]
    taken = ", ".join(f"{library} {count}" for library, count in counts.items())
    return f"{taken}, on {cores()} cores; while they wait: {waiting_in_words()}"


def number_types() -> str:
    """How long bfloat16 takes against float32, and what that means for trainings."""
    import torch  # noqa: PLC0415

    from imgtransfer.training.precision import Workload, bfloat16_ratio, choose_precision, times  # noqa: PLC0415

    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    ratio = bfloat16_ratio(device, Workload())
    chosen = choose_precision("auto", lambda: ratio)
    return f"{times(ratio)} as long as float32; trainings with precision: auto take {chosen.name}"


def _cpu_flags() -> set[str]:
    lines = CPU_INFO.read_text().splitlines() if CPU_INFO.is_file() else []
    for line in lines:
        name, _, value = line.partition(":")
        if name.strip() in ("flags", "Features"):
            return set(value.split())
    return set()
