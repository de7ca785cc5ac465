"""The same results whatever the number of threads: every part with BLAS and torch on one, two and three of them.

Equal to the bit but for what the networks compute: torch's matrix products are shared out over its threads, and sum in
another order on each number of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from fusion import fuse
from imgtransfer.bodies.anny import load_body
from imgtransfer.bodies.shape import AnnyShape
from imgtransfer.data.clip import save_clip
from imgtransfer.evaluation.metrics import evaluate_clip
from imgtransfer.garments.config import SkirtConfig
from imgtransfer.garments.garment import make_garment
from imgtransfer.motions.library import make_motion
from imgtransfer.network.maps import metric_maps
from imgtransfer.running import Outcome, Serial
from imgtransfer.simulation.run import simulate_clip
from imgtransfer.training.trainer import Trainer
from render import Mesh, TemplateImager
from tests.helpers.fusion_examples import inputs_of
from tests.helpers.models import model_for
from tests.helpers.simulations import short
from tests.helpers.synthetic import tube_clip
from tests.helpers.training import small_config

COUNTS = (1, 2, 3)


def blas_threads() -> int:
    """How many threads the BLAS libraries of this process use at most; some are built for one."""
    return max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")


@contextmanager
def on_threads(count: int) -> Iterator[None]:
    """A machine of so many cores: as many threads for BLAS and for torch."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count, user_api="blas"):
            assert blas_threads() == count
            yield
    finally:
        torch.set_num_threads(before)


def under_each(compute: Callable[[], list[np.ndarray]]) -> list[list[np.ndarray]]:
    """What comes out on each number of threads."""
    found = []
    for count in COUNTS:
        with on_threads(count):
            found.append(compute())
    return found


def same(found: list[list[np.ndarray]]) -> bool:
    """Whether all are equal to the bit."""
    return all(
        np.array_equal(*pair, equal_nan=True)
        for other in found[1:]
        for pair in zip(other, found[0], strict=True)
    )


def simulated() -> list[np.ndarray]:
    clip = simulate_clip(make_motion("walk", seconds=0.2), short())[0]
    assert clip.garment is not None
    return [clip.template.vertices, clip.garment.vertices, clip.body.vertices]


def garments() -> list[np.ndarray]:
    """A skirt, refitted: fields, cuts, and the sparse system that SciPy solves by BLAS."""
    skirt = SkirtConfig(edge_length=0.06, length=0.3)
    made = make_garment(load_body(AnnyShape(weight=0.6)), skirt, like=load_body())
    return [made.mesh.vertices, made.mesh.faces]


def fused() -> list[np.ndarray]:
    clip = tube_clip(20)  # two batches and a half on one thread, three of seven frames on three
    imager = TemplateImager.build(Mesh(clip.template.vertices, clip.template.faces), size=(48, 32))
    positions, normals = metric_maps(imager, torch.from_numpy(clip.garment.vertices))
    found = fuse(
        imager, inputs_of(positions=positions, normals=normals, body=(clip.body.vertices, clip.body.faces))
    )
    return [found.initial, found.vertices]


def measured() -> list[np.ndarray]:
    clip = tube_clip()
    assert clip.garment is not None
    predicted = clip.garment.vertices + np.float32(0.003) * np.sin(40 * clip.garment.vertices[..., ::-1])
    values = evaluate_clip(
        predicted, clip.garment.vertices, clip.template.faces, clip.body.vertices, clip.body.faces
    )
    return [np.array(list(values.values()))]


@pytest.mark.parametrize("part", [simulated, garments, fused, measured], ids=lambda part: part.__name__)
def test_results_are_equal_to_the_bit(part: Callable[[], list[np.ndarray]]) -> None:
    assert same(under_each(part))


def test_predictions_are_equal_to_rounding() -> None:
    """Maps are in [0, 1]; float32 has 24 bits, and a few layers add up a few of the last."""
    clip = tube_clip()
    model = model_for(clip)

    def predicted() -> list[np.ndarray]:
        found = model.predict(clip)
        return [found.positions.numpy(), found.normals.numpy()]

    first, *others = under_each(predicted)
    for other in others:
        for found, wanted in zip(other, first, strict=True):
            np.testing.assert_allclose(found, wanted, rtol=0, atol=2e-6)


def test_training_is_equal_to_rounding(tmp_path: Path) -> None:
    """The weights at the start to the bit; then losses whose differences the steps carry on."""
    save_clip(tmp_path / "first.npz", tube_clip())
    save_clip(tmp_path / "second_test.npz", tube_clip(3))
    config = small_config(tmp_path, threads=None)

    def trained() -> list[np.ndarray]:
        trainer = Trainer(config)
        start = torch.cat([weight.flatten() for weight in trainer.model.state_dict().values()])
        losses = [list(trainer.train_step().values()) for _ in range(2)]
        return [start.numpy(), np.array(losses)]

    found = under_each(trained)
    assert same([[start] for start, _ in found])
    for _, losses in found[1:]:
        np.testing.assert_allclose(losses, found[0][1], rtol=1e-5)


def test_a_task_has_one_blas_thread_and_torch_keeps_its_own() -> None:
    with on_threads(2):
        (outcome,) = Serial().outcomes(_threads, [0])
        assert outcome == Outcome(0, (1, 2))
        assert blas_threads() == 2


def _threads(task: int) -> tuple[int, int]:
    return blas_threads(), torch.get_num_threads()
