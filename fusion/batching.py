"""How many frames are solved together, and how many such batches at the same time; results do not depend on either."""

from __future__ import annotations

import torch

from fusion.config import FusionConfig
from fusion.parallel import n_threads
from fusion.solvers.recorder import lanes_on

# Vertices of a batch beyond which its arrays leave a core's cache: of 1,800 vertices 16 frames at once take 0.89 of
# the time of twice 8, of 4,500 about the same, and 32 take 1.2 times as long.
_VERTICES_AT_ONCE = 32_768
_OVERHEAD = 2  # frames whose time a batch takes by itself, whatever its size


def usable_threads(config: FusionConfig, device: torch.device, n_frames: int) -> int:
    """How many batches are solved at the same time. Those of Adam, the reference, are solved one after the other.

    Args:
        config: solver, and whether frames depend on each other.
        device: computes; only the CPU's cores are shared out.
        n_frames: of the clip.

    Returns:
        1 or more, at most `n_frames` and `n_threads()`.
    """
    if config.solver == "adam" or config.warm_start or device.type != "cpu":
        return 1
    return max(1, min(n_threads(), n_frames))


def frames_at_once(
    config: FusionConfig, device: torch.device, *, threads: int, n_frames: int, n_vertices: int
) -> int:
    """The size of a batch: one frame where each awaits another.

    On a CPU no more than its caches hold, and fewer where a thread would otherwise wait for the last batch.

    Args:
        config: largest batch, and how frames depend on each other.
        device: computes.
        threads: as `usable_threads` says.
        n_frames: of the clip.
        n_vertices: of the garment.
    """
    if config.warm_start:
        return 1
    most, lanes = min(config.batch_frames, -(-n_frames // threads)), lanes_on(device)
    if device.type != "cpu":
        return most
    most = min(most, max(lanes, _VERTICES_AT_ONCE // n_vertices // lanes * lanes))

    def busiest(size: int) -> int:
        """Of the thread with the most to do: its time, in frames."""
        batches = -(-n_frames // size)
        in_turn = -(-batches // threads)
        return min(n_frames, in_turn * size) + in_turn * _OVERHEAD

    return min(range(most, 0, -lanes), key=busiest)
