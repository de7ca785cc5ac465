"""The number type of the networks' products: bfloat16 where this device computes faster in it, float32 elsewhere.

A CPU without bfloat16 units emulates them, and takes ten and more times as long as in float32; one that has them takes
about half. Neither its name nor its flags tell (libraries and their settings decide, too), so it is measured.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Literal

import torch
from torch import nn

from imgtransfer.network.attention import mlp
from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.decoder import DecoderBlock
from imgtransfer.network.encoders import encoder_sizes

NumberType = Literal["float32", "bfloat16"]
MARGIN = (
    0.1  # fraction of the time that bfloat16 must save: chance shall not decide, and float32 is more exact
)
_SECONDS, _MOST_ROUNDS = 0.5, 10
# Of one call on a CPU, see `Workload`: a fifth of a second at most where bfloat16 is emulated.
_MOST_WORK = 2**22


@dataclass(frozen=True)
class Workload:
    """What is timed: the networks' MLP and one decoder block on this many features, forward and backward.

    Args:
        images: frames times views.
        rows, columns: patches of an image.
        dim: width of the tokens.
    """

    images: int = 16
    rows: int = 8
    columns: int = 8
    dim: int = 128

    @classmethod
    def of(cls, maps: MapsConfig, network: NetworkConfig, frames: int) -> Workload:
        """That of a run with `frames` frames in a batch."""
        encoder = encoder_sizes(network.encoder, maps.size)
        rows, columns = (length // encoder.patch for length in maps.size)
        return cls(frames * len(maps.views) * maps.layers, rows, columns, encoder.dim)

    def for_a_cpu(self) -> Workload:
        """As much of it as a CPU that emulates bfloat16 does in a moment; enough that sums cost more than calls."""
        rows, columns = (max(4, min(length, 8)) for length in (self.rows, self.columns))
        dim = max(64, min(self.dim, 256))
        most = max(1, _MOST_WORK // (rows * columns * dim**2))
        return Workload(min(max(self.images, 4), most), rows, columns, dim)


@dataclass(frozen=True)
class Precision:
    """A number type, and why.

    Args:
        name: of the products.
        ratio: how many times as long as float32 bfloat16 takes on this device; None where nobody needed to know.
        asked: whether the configuration asks for this one by name.
    """

    name: NumberType
    ratio: float | None = None
    asked: bool = False

    def __str__(self) -> str:
        """One line for the user, a warning where what was asked for is the slower one."""
        if self.ratio is None:
            return f"number type: {self.name}, as asked for"
        measured = f"bfloat16 takes {times(self.ratio)} as long as float32 on this device"
        if self.asked and self.ratio > 1:
            return f"warning: training.precision is {self.name}, but {measured}; auto would take float32"
        return f"number type: {self.name}{', as asked for' if self.asked else ''} ({measured})"

    def log_entry(self) -> dict[str, str | float]:
        """What the log of a run says about it."""
        measured = {} if self.ratio is None else {"bfloat16_to_float32": round(self.ratio, 3)}
        return {"precision": self.name, **measured}


def times(ratio: float) -> str:
    """A ratio in words, two digits: "0.53 times", "110 times"."""
    return f"{ratio:.0f} times" if ratio >= 10 else f"{ratio:.2g} times"


def choose_precision(wanted: Literal["auto", "float32", "bfloat16"], ratio: Callable[[], float]) -> Precision:
    """What a run computes in.

    Args:
        wanted: by its configuration.
        ratio: measures how many times as long as float32 bfloat16 takes; not called for float32.
    """
    if wanted == "float32":
        return Precision("float32", asked=True)
    measured = ratio()
    if wanted == "bfloat16":
        return Precision("bfloat16", measured, asked=True)
    return Precision("bfloat16" if measured <= 1 - MARGIN else "float32", measured)


def bfloat16_ratio(device: torch.device, workload: Workload) -> float:
    """How many times as long as float32 bfloat16 takes on this device; measured once a process.

    That takes half a second, or two calls where those are longer.
    On a CPU one thread's own time counts, because what else the machine does would otherwise decide: beside busy
    processes threads wait for each other most of the time, in either number type.
    """
    return _measured(device, workload.for_a_cpu() if device.type == "cpu" else workload)


@cache
def _measured(device: torch.device, workload: Workload) -> float:
    clock = time.thread_time if device.type == "cpu" else time.perf_counter
    with torch.random.fork_rng(devices=[]), _one_thread():
        call = _call(device, workload)
        seconds: dict[bool, list[float]] = {False: [], True: []}
        end = time.monotonic() + _SECONDS
        for done in range(_MOST_ROUNDS):
            if done >= 2 and time.monotonic() > end:  # the first round also loads and compiles
                break
            for bfloat16, taken in seconds.items():
                started = clock()
                call(bfloat16)
                taken.append(clock() - started)
    return min(seconds[True]) / min(seconds[False])


def _call(device: torch.device, workload: Workload) -> Callable[[bool], None]:
    """A function that does the work, in bfloat16 or not."""
    networks = nn.ModuleList([mlp(workload.dim), DecoderBlock(workload.dim)]).to(device)
    shape = (workload.images, workload.rows, workload.columns, workload.dim)
    tokens = torch.randn(shape, device=device, requires_grad=True)
    inputs = tokens.flatten(1, 2), tokens.movedim(-1, 1)  # the second in the layout that the decoder has

    def call(bfloat16: bool) -> None:
        with torch.autocast(device.type, torch.bfloat16, enabled=bfloat16):
            results = [network(features) for network, features in zip(networks, inputs, strict=True)]
        loss = torch.stack([result.float().mean() for result in results]).sum()
        torch.autograd.grad(loss, [tokens, *networks.parameters()])
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    return call


@contextmanager
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
