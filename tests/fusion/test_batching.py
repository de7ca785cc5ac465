"""How a clip is cut into batches for the threads that there are."""

import pytest
import torch

from fusion import FusionConfig
from fusion.batching import frames_at_once, usable_threads

CPU, CUDA = torch.device("cpu"), torch.device("cuda")


@pytest.mark.parametrize(
    ("options", "frames", "want"),
    [
        ({}, 100, 3),
        ({}, 2, 2),
        ({}, 1, 1),
        ({}, 0, 1),
        ({"solver": "adam"}, 100, 1),
        ({"warm_start": True}, 100, 1),
        ({"smooth_time_s": 1.0}, 100, 3),
    ],
)
def test_threads_are_as_many_as_there_are_and_frames_can_use(monkeypatch, options, frames, want):
    monkeypatch.setattr("fusion.batching.n_threads", lambda: 3)
    assert usable_threads(FusionConfig(**options), CPU, frames) == want
    assert usable_threads(FusionConfig(**options), CUDA, frames) == 1


def size_of(options, threads, frames, vertices=100, device=CPU):
    config = FusionConfig(**options)
    return frames_at_once(config, device, threads=threads, n_frames=frames, n_vertices=vertices)


@pytest.mark.parametrize(
    ("options", "threads", "frames", "want"),
    [
        ({"batch_frames": 8}, 1, 100, 8),
        ({"batch_frames": 8}, 1, 5, 5),
        ({"batch_frames": 8}, 4, 10, 3),  # 3 + 3 + 3 + 1: no thread is idle
        ({"batch_frames": 2}, 4, 10, 2),
        ({"batch_frames": 8, "warm_start": True}, 1, 10, 1),
        ({"batch_frames": 16}, 1, 48, 16),
        ({"batch_frames": 16}, 2, 48, 8),  # 24 + 24, in place of 32 + 16
        ({"batch_frames": 16}, 2, 60, 16),  # 32 + 28, as with 8, in half as many batches
        (
            {"batch_frames": 16},
            2,
            1000,
            16,
        ),  # eight frames more for one thread, of 500, cost less than many batches
    ],
)
def test_a_batch_is_no_larger_than_leaves_work_for_every_thread(options, threads, frames, want):
    assert size_of(options, threads, frames) == want


@pytest.mark.parametrize(("vertices", "want"), [(1_000, 32), (1_829, 16), (4_460, 8), (100_000, 8)])
def test_a_batch_fits_a_cores_cache_in_whole_groups_of_frames(vertices, want):
    assert size_of({"batch_frames": 50}, 1, 320, vertices) == want
    assert size_of({"batch_frames": 50}, 1, 320, vertices, CUDA) == 50
    assert size_of({"batch_frames": 3}, 1, 320, vertices) == 3
