"""Work shared out over threads: the same numbers, whatever their count."""

import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import pytest
import torch

from fusion import BodySdf, FusionConfig, fuse, parallel
from fusion.parallel import in_order, n_threads, one_torch_thread, run_all
from fusion.solvers import energy_kernels
from tests.helpers.fusion_examples import cylinder_body, imager_of, inputs_of, true_maps, tube, wrinkled


@pytest.fixture(params=[2, 3])
def threads(request, monkeypatch):
    monkeypatch.setattr("fusion.obstacles.bvh._WORTH_A_THREAD", 1)
    token = parallel._threads.set(request.param)
    yield request.param
    parallel._threads.reset(token)


def fused(count, **inputs):
    token = parallel._threads.set(count)
    result = fuse(imager_of(tube()), inputs_of(**inputs), history=True)
    parallel._threads.reset(token)
    return result


def test_a_fusion_does_not_depend_on_the_number_of_threads(threads):
    """Frames, their order, and what is reported of them; vertices to the bit, as each frame is solved by itself."""
    positions, normals = true_maps(imager_of(tube()), wrinkled(tube(), 5))
    found, want = (fused(count, positions=positions, normals=normals) for count in (threads, 1))
    np.testing.assert_array_equal(found.vertices, want.vertices)
    np.testing.assert_array_equal(found.initial, want.initial)
    assert found.report["iterations"] == want.report["iterations"]
    for stage, curves in want.report["history"].items():
        np.testing.assert_allclose(found.report["history"][stage]["total"], curves["total"], rtol=1e-5)


def test_threads_that_define_kernels_at_once_get_the_same(monkeypatch):
    """The second definition took the first one's place in Warp's module, whose kernels then could not be launched."""
    calls = []

    def slow(bits, lanes):
        calls.append((bits, lanes))
        time.sleep(0.05)
        return object()

    monkeypatch.setattr(energy_kernels, "_defined", cache(slow))
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(energy_kernels.kernels, [32] * 4, [8] * 4))
    assert len(set(map(id, found))) == len(calls) == 1


def test_each_frame_meets_its_own_body_on_every_thread(threads):
    positions, _ = true_maps(imager_of(tube()), wrinkled(tube(), 5))
    body = cylinder_body(radius=0.16)
    moved = np.stack([body.vertices + np.array([0.01 * k, 0, 0]) for k in range(5)])
    inputs = {"positions": positions, "body": (moved, body.faces)}
    found, want = (fused(count, **inputs) for count in (threads, 1))
    np.testing.assert_array_equal(found.vertices, want.vertices)
    assert found.report["penetration_percent"]["after"] == 0


def test_a_frame_that_is_finished_stays_when_others_ask_again_where_the_body_is():
    """It was put on the new planes and left there, so that what became of it hung on the frames beside it."""
    positions, _ = true_maps(imager_of(tube()), wrinkled(tube(), 5))
    body = cylinder_body(radius=0.16)
    moved = np.stack([body.vertices + np.array([0.01 * k, 0, 0]) for k in range(5)])
    config = FusionConfig(sdf_every_iterations=7)

    def solved(frames: slice) -> np.ndarray:
        inputs = inputs_of(positions=positions[frames], body=(moved[frames], body.faces))
        return fuse(imager_of(tube()), inputs, config).vertices

    together = solved(slice(0, 5))
    for frame in range(5):
        np.testing.assert_array_equal(solved(slice(frame, frame + 1))[0], together[frame])


def test_a_fusion_that_fails_on_a_thread_fails_here(monkeypatch):
    def fail(self, problem):
        raise RuntimeError("of one batch")

    monkeypatch.setattr("fusion.solvers.local_global.LocalGlobalSolver.edge_stage", fail)
    imager = imager_of(tube())
    token = parallel._threads.set(2)
    with pytest.raises(RuntimeError, match="of one batch"):
        fuse(imager, inputs_of(positions=true_maps(imager, wrinkled(tube(), 4))[0]))
    parallel._threads.reset(token)


@pytest.mark.parametrize("poses", [1, 2, 5])
def test_distances_do_not_depend_on_the_number_of_threads(threads, poses):
    body = cylinder_body()
    posed = np.stack([body.vertices + 0.01 * k for k in range(poses)])
    points = wrinkled(tube(), poses)
    answers = []
    for count in (threads, 1):
        token = parallel._threads.set(count)
        sdf = BodySdf(body.faces, len(body.vertices))
        sdf.update(posed)
        answers.append(sdf.query(points))
        parallel._threads.reset(token)
    for name in ("distance", "direction", "closest"):
        assert torch.equal(*(getattr(answer, name) for answer in answers))


def test_torch_keeps_to_one_thread_inside_and_the_others_are_remembered():
    before = torch.get_num_threads()
    with one_torch_thread():
        assert torch.get_num_threads() == 1
        assert n_threads() == before
        with one_torch_thread():  # a fusion inside of another
            assert n_threads() == before
    assert torch.get_num_threads() == n_threads() == before


def test_what_fails_on_a_thread_is_raised_here():
    def fail():
        raise ValueError("of the second piece")

    with pytest.raises(ValueError, match="second piece"):
        run_all([lambda: None, fail])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_results_come_in_the_order_of_their_items_however_long_each_takes(count):
    def doubled(number):
        time.sleep(0.02 * (number % 2 == 0))
        return 2 * number

    assert list(in_order(doubled, range(7), threads=count)) == [0, 2, 4, 6, 8, 10, 12]


@pytest.mark.parametrize("count", [1, 2])
def test_no_more_items_are_asked_for_than_keep_the_threads_busy(count):
    """A clip of any length is predicted and fused in the memory of a few batches."""
    asked = []
    results = in_order(lambda item: item, (asked.append(item) or item for item in range(20)), threads=count)
    for number in range(5):
        assert next(results) == number
        assert len(asked) <= number + 1 + count
    results.close()
    assert len(asked) < 10


def test_torch_has_the_threads_in_each_of_several_that_it_is_given():
    found = list(in_order(lambda _: torch.get_num_threads(), range(4), threads=2, torch_threads=3))
    assert found == [3] * 4


@pytest.mark.parametrize("count", [1, 2])
def test_an_item_that_fails_fails_in_its_turn(count):
    results = in_order(lambda number: 6 // number, [3, 2, 0, 1], threads=count)
    assert [next(results), next(results)] == [2, 3]
    with pytest.raises(ZeroDivisionError):
        next(results)
