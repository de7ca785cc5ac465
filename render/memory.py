"""Whether there is memory for what somebody asks for, before it is taken."""

from __future__ import annotations

from pathlib import Path

from render.errors import InputError


def check_memory(needed: int, what: str) -> None:
    """Raise InputError where `what` needs more bytes than are free, if the system says how many are."""
    free = available_bytes()
    if free is not None and needed > free:
        raise InputError(
            f"{what} need {needed / 2**30:.1f} GiB of memory, and {free / 2**30:.1f} GiB are free; fewer or smaller "
            "ones are wanted"
        )


def available_bytes() -> int | None:
    """Memory that can be had without swapping, None where the system does not say."""
    try:
        with Path("/proc/meminfo").open() as file:
            for line in file:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    return None
