#!/usr/bin/env python
"""Training: what the frozen trunk's file, the loader and a second process do to a step, and each choice made for speed.

One step of configs/demo.yaml's networks on a synthetic clip.
A tube of cloth (1,944 vertices) about a body, as large as those of the sample data; batch, map size and network are
the configuration's, the number type is the one that `precision: auto` takes here. One torch thread.
`--only trunk loader processes` takes these sections alone, in about five minutes of two idle cores.

  ratio_anew_to_cached*         sections trunk, loader and processes: see `trunk.py`, `loader.py` and `processes.py`,
  share_of_reading_*            of which the first two run by themselves, too
  step_s_*_process(es)          two processes against one, at the same number of frames a step

  step_ms                       one whole step: maps, both networks forward and backward, optimiser
  bfloat16_to_float32           what `precision: auto` measured at the start
  maps_ms, share_of_maps        making the maps of a batch, body's and garment's, with the first guess
  ratio_a_to_b                  how many times as long a takes as b
  attention_*                   one attention layer forward and backward, 65 tokens (128 / 16) or 257 (128 / 8)
  ratio_fused_to_written_*      torch's scaled_dot_product_attention against the products written out
  decoder_*, polar_*            the decoder by its memory layout; rotations by Newton's iteration or by an SVD
  steps_per_s_*                 two threads on two cores, alone or beside one busy process there, where OpenMP's threads
                                spin while they wait (its default) or sleep (as this project's commands have it)
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from torch import Tensor
from torch.nn import functional

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from imgtransfer.config.loader import load_config
from imgtransfer.data.clip import save_clip
from imgtransfer.network.attention import Attention
from imgtransfer.network.decoder import Decoder
from imgtransfer.network.local_frames import nearest_rotation
from imgtransfer.training.config import RunConfig
from imgtransfer.training.precision import Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.trainer import Trainer
from scripts.bench import loader, neighbours, processes, trunk
from scripts.bench.clips import synthetic_clip
from scripts.bench.measuring import Results, command, interleaved

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "demo.yaml"
QUICK = ["maps.size=[32, 32]", "training.batch_frames=2"]
PRECISIONS = {"float32": False, "bfloat16": True}  # by name: whether autocast is on


SECTIONS = ("trunk", "loader", "processes", "step", "neighbours", "parts")


def measure(quick: bool, only: Sequence[str] = SECTIONS) -> Results:
    """All numbers of these sections."""
    made: dict[str, Callable[[bool], dict[str, float]]] = {
        "trunk": lambda quick: trunk.measure(quick)["trunk"],
        "loader": lambda quick: loader.measure(quick)["loader"],
        "processes": _processes,
        "step": _step,
        "neighbours": _neighbours,
        "parts": _parts,
    }
    results: Results = {}
    for name in only:
        results[name] = made[name](quick)
        print(f"{name} done", file=sys.stderr)
    return results


@contextmanager
def _on_a_tube(quick: bool) -> Iterator[list[str]]:
    """Changes to the configuration: data of a synthetic clip, and small sizes for a quick run."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "tube.npz"
        sizes = ((16, 10), (14, 12), 4) if quick else ((54, 36), (58, 48), 64)
        save_clip(source, synthetic_clip(*sizes))
        data = [f"data.{part}={{split: null}}" for part in ("train", "validation")]
        yield [*(QUICK if quick else []), f"data.source={source}", *data]


def _chosen_precision(quick: bool) -> str:
    """What `precision: auto` takes here, the same for all processes of a section."""
    config = load_config(RunConfig, CONFIG, QUICK if quick else [])
    workload = Workload.of(config.maps, config.network, config.training.batch_frames)
    return choose_precision("auto", lambda: bfloat16_ratio(torch.device("cpu"), workload)).name


def _processes(quick: bool) -> dict[str, float]:
    batch = 2 if quick else 4
    with _on_a_tube(quick) as changes:
        changes += [f"training.batch_frames={batch}", f"training.precision={_chosen_precision(quick)}"]
        return processes.measure(CONFIG, changes, 4 if quick else 5)


def _neighbours(quick: bool) -> dict[str, float]:
    # With one thread nothing waits, and a quick run is quick beside other processes, too.
    threads = 1 if quick else neighbours.CORES
    with _on_a_tube(quick) as changes:
        changes += [f"training.precision={_chosen_precision(quick)}", f"training.threads={threads}"]
        return neighbours.measure(CONFIG, changes, 1 if quick else 5)


def _parts(quick: bool) -> dict[str, float]:
    """Layers and functions by themselves, in the sizes of the configuration."""
    rounds = 1 if quick else 7
    config = load_config(RunConfig, CONFIG, QUICK if quick else [])
    images, encoder = config.training.batch_frames * len(config.maps.views), config.network.vit
    found: dict[str, float] = {}
    for tokens in (17,) if quick else (65, 257):
        for precision in PRECISIONS:
            found |= _attention((images, tokens, encoder.dim), encoder.heads, precision, rounds)
    grid = tuple(length // encoder.patch for length in config.maps.size)
    found |= _decoder(images, encoder.dim, grid, encoder.patch, rounds)
    # As many as a batch has cells: `imgtransfer.network.local_frames` fits 32 x 32 rotations a view.
    return found | _rotations(images * (8 if quick else 32) ** 2, rounds)


def _step(quick: bool) -> dict[str, float]:
    """One whole step, and the same with other choices."""
    with _on_a_tube(quick) as changes:
        return _whole_step(changes, 1 if quick else 7)


def _whole_step(changes: list[str], rounds: int) -> dict[str, float]:
    def trainer(*more: str) -> Trainer:
        return Trainer(load_config(RunConfig, CONFIG, [*changes, "training.threads=1", *more]))

    ours, patch8 = trainer(), trainer("network.encoder.patch=8")
    by_type = {name: trainer(f"training.precision={name}") for name in PRECISIONS}
    frames = ours.order.frames(0)

    def fused() -> None:
        with patch.object(Attention, "forward", _fused_forward):
            ours.train_step()

    times = interleaved(
        {
            "ours": ours.train_step,
            **{name: by_type[name].train_step for name in PRECISIONS},
            "fused": fused,
            "patch8": patch8.train_step,
            "maps": lambda: ours.batch(ours.train_frames, frames),
        },
        rounds=rounds,
    )
    return {
        "step_ms": times.ms("ours"),
        "maps_ms": times.ms("maps"),
        "share_of_maps": times.ratio("maps", "ours"),
        "bfloat16_to_float32": ours.precision.ratio or math.nan,
        "ratio_float32_to_bfloat16": times.ratio("float32", "bfloat16"),
        "ratio_fused_to_written_attention": times.ratio("fused", "ours"),
        "ratio_patch_8_to_16": times.ratio("patch8", "ours"),
    }


def _attention(shape: tuple[int, int, int], heads: int, precision: str, rounds: int) -> dict[str, float]:
    """One layer for (images, tokens, dim)."""
    torch.manual_seed(0)
    layer = Attention(shape[-1], heads)
    inputs, upstream = torch.randn(shape, requires_grad=True), torch.randn(shape)

    def run(forward: Callable[[Attention, Tensor, Tensor], Tensor]) -> None:
        with torch.autocast("cpu", torch.bfloat16, enabled=PRECISIONS[precision]):
            result = forward(layer, inputs, inputs)
        torch.autograd.grad(result, [inputs, *layer.parameters()], upstream.to(result))

    times = interleaved(
        {"written": lambda: run(Attention.forward), "fused": lambda: run(_fused_forward)},
        rounds=rounds,
    )
    case = f"{shape[1]}_{precision}"
    return {
        f"attention_ms_{case}": times.ms("written"),
        f"ratio_fused_to_written_{case}": times.ratio("fused", "written"),
    }


def _fused_forward(layer: Attention, tokens: Tensor, context: Tensor) -> Tensor:
    """`Attention.forward` by torch's fused kernel."""
    query = layer._split(layer.query(tokens))
    key, value = (layer._split(part) for part in layer.key_value(context).chunk(2, dim=-1))
    return layer.output(functional.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2))


def _decoder(images: int, dim: int, grid: tuple[int, ...], side: int, rounds: int) -> dict[str, float]:
    """The decoder's convolutions by the memory layout of their input; the network's tokens come as `unchanged`."""
    torch.manual_seed(0)
    decoder = Decoder(dim=dim, blocks=side.bit_length() - 1, linear=True, zero_start=False)
    tokens = torch.randn(images, 1 + grid[0] * grid[1], dim)
    unchanged = tokens[:, 1:].unflatten(1, grid).movedim(-1, 1)
    layouts = {
        "channels_last": unchanged.contiguous(memory_format=torch.channels_last),
        "unchanged": unchanged,
        "standard": unchanged.contiguous(),
    }

    def run(features: Tensor, precision: str) -> None:
        features = features.detach().requires_grad_()
        with torch.autocast("cpu", torch.bfloat16, enabled=PRECISIONS[precision]):
            result = _without_layout(decoder, features)
        torch.autograd.grad(result.float().sum(), [features, *decoder.parameters()])

    found = {}
    for precision in PRECISIONS:
        times = interleaved(
            {name: partial(run, features, precision) for name, features in layouts.items()}, rounds=rounds
        )
        found[f"decoder_ms_{precision}"] = times.ms("channels_last")
        for name in ("standard", "unchanged"):
            found[f"ratio_{name}_to_channels_last_{precision}"] = times.ratio(name, "channels_last")
    return found


def _without_layout(decoder: Decoder, features: Tensor) -> Tensor:
    """`Decoder.forward` without its first line."""
    assert decoder.linear is not None
    patches = decoder.linear(features)
    for block in decoder.blocks:
        features = block(features)
    return decoder.to_image(functional.silu(features)) + patches


def _rotations(count: int, rounds: int) -> dict[str, float]:
    """Nearest rotations of `count` matrices."""
    generator = torch.Generator().manual_seed(0)
    matrices = torch.eye(3) + 0.3 * torch.randn(count, 3, 3, generator=generator)

    def by_svd() -> Tensor:
        u, _, vh = torch.linalg.svd(matrices)
        return u @ vh

    times = interleaved({"polar": lambda: nearest_rotation(matrices), "svd": by_svd}, rounds=min(rounds, 3))
    return {"polar_ms": times.ms("polar"), "ratio_svd_to_polar": times.ratio("svd", "polar")}


def _options() -> tuple[dict[str, Any], list[str]]:
    """The arguments of `measure` on the command line, and the words that are left for `command`."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS)
    options, words = parser.parse_known_args()
    return vars(options), words


if __name__ == "__main__":
    given, rest = _options()
    command(__doc__, partial(measure, **given), rest)
