"""Training reads frames when it needs them: the same frames whatever the memory, and each chunk about once an epoch."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from imgtransfer.data.canonical import root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import clip_refs
from imgtransfer.data.store import DataSet
from imgtransfer.training.order import Order
from imgtransfer.training.sampler import Frames
from tests.helpers import synthetic

LENGTHS = {"tube/a": 70, "tube/b": 33, "tube/c": 64}  # 3, 2 and 2 chunks
BYTES_A_FRAME = 12 * (192 + 128)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = DataSet.create(tmp_path_factory.mktemp("frames") / "set")
    for name, length in LENGTHS.items():
        data.write(name, synthetic.tube_clip(length, name=name), split="train")
    return data.path


def frames_of(source: Path, cache_bytes: int) -> Frames:
    return Frames([ref.reader() for ref in clip_refs(source)], "root", cache_bytes)


@pytest.mark.parametrize("cache_bytes", [1, 40 * BYTES_A_FRAME, 10**9])
def test_frames_are_those_of_the_clips_whatever_the_memory(source: Path, cache_bytes: int) -> None:
    frames = frames_of(source, cache_bytes)
    clips = [synthetic.tube_clip(length) for length in LENGTHS.values()]
    garments = np.concatenate([root_frames(c, "root").to_canonical(_garment(c)) for c in clips])
    bodies = np.concatenate([root_frames(c, "root").to_canonical(c.body.vertices) for c in clips])
    assert len(frames) == len(garments) == sum(LENGTHS.values())
    assert frames.n_chunks == 7
    for index in ([0], [69, 70, 102, 103, 166], [5, 150, 5, 31, 32], list(range(166, 160, -1))):
        garment, body, shape = frames.read(torch.tensor(index))
        np.testing.assert_array_equal(garment, garments[index])
        np.testing.assert_array_equal(body, bodies[index])
        assert shape.tolist() == [0] * len(index)
    np.testing.assert_array_equal(
        frames.garment_bounds(), [garments.min(axis=(0, 1)), garments.max(axis=(0, 1))]
    )


def _garment(clip: Clip) -> np.ndarray:
    assert clip.garment is not None
    return clip.garment.vertices


def test_what_fits_is_read_once(source: Path) -> None:
    frames = frames_of(source, 10**9)
    order = frames.order(8, seed=0)
    for step in range(3 * len(frames) // 8):
        frames.read(order.frames(step))
    assert frames.chunk_reads == frames.n_chunks


def test_what_does_not_fit_is_read_about_once_an_epoch(source: Path) -> None:
    frames = frames_of(source, 100 * BYTES_A_FRAME)  # of 167
    order = frames.order(8, seed=0)
    for step in range(4 * len(frames) // 8):
        frames.read(order.frames(step))
    assert frames.chunk_reads < 1.5 * 4 * frames.n_chunks
    random = frames_of(source, 100 * BYTES_A_FRAME)
    fully = Order(len(random), 8, 0)
    for step in range(4 * len(random) // 8):
        random.read(fully.frames(step))
    assert random.chunk_reads > 2 * frames.chunk_reads


def test_an_order_by_chunks_sees_every_frame_once_an_epoch_and_can_be_resumed() -> None:
    lengths = [32, 32, 6, 32, 1, 32, 32]
    order = Order(167, 1, seed=3, chunks=lengths, window=80)
    walked = torch.cat([order.frames(step) for step in range(2 * 167)])
    for epoch in (walked[:167], walked[167:]):
        assert torch.equal(epoch.sort().values, torch.arange(167))
    assert not torch.equal(walked[:167], walked[167:])
    again = Order(167, 1, seed=3, chunks=lengths, window=80)
    assert torch.equal(again.frames(200), walked[200:201])
    # Frames of a window come from few chunks, and not in the order in which they lie there.
    chunk = torch.repeat_interleave(torch.arange(7), torch.tensor(lengths))
    assert len(chunk[walked[:80]].unique()) <= 5
    steps = walked[1:80] - walked[:79]
    assert (steps == 1).float().mean() < 0.2


def test_training_reads_from_a_url(source: Path, tmp_path: Path) -> None:
    import yaml  # noqa: PLC0415

    from imgtransfer.cli.main import main  # noqa: PLC0415
    from tests.helpers.training import SMALL  # noqa: PLC0415

    data = DataSet.create("memory://bucket/train")
    for split in ("train", "validation"):
        data.write(f"tube/{split}", synthetic.tube_clip(), split=split)
    run = SMALL | {"data": {"source": "memory://bucket/train"}}
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(run))
    assert main(["train", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out/model.safetensors").is_file()
