"""How the threads of the numerical libraries wait for each other. Imports nothing heavy: it must be called before
PyTorch is loaded, whose OpenMP reads its environment then.

An OpenMP thread that has done its part spins for a while before it sleeps. Where another process wants the same cores,
that takes them from the thread that all wait for, and a training on two cores runs at a fraction of its speed
(docs/performance.md). Threads that sleep at once cost little where nothing else runs.
"""

from __future__ import annotations

import os

WAIT_POLICY = "OMP_WAIT_POLICY"
# GNU's, LLVM's and Intel's OpenMP know the first; each of the others says the same to one of them.
CHOSEN_BY = (WAIT_POLICY, "GOMP_SPINCOUNT", "KMP_BLOCKTIME", "KMP_LIBRARY")


def passive_waiting() -> dict[str, str]:
    """What to add to the environment of a process that is about to start; nothing where the user has chosen."""
    return {} if any(name in os.environ for name in CHOSEN_BY) else {WAIT_POLICY: "PASSIVE"}


def wait_passively() -> None:
    """Let this process's threads sleep while they wait, unless the user has chosen; for the start of a command."""
    os.environ.update(passive_waiting())


def waiting_in_words() -> str:
    """What the environment says about waiting threads: "OMP_WAIT_POLICY=PASSIVE", or that nothing is said."""
    said = [f"{name}={os.environ[name]}" for name in CHOSEN_BY if name in os.environ]
    return ", ".join(said) or f"no {WAIT_POLICY}"
