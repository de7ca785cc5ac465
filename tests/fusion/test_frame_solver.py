"""How a clip is cut into batches and handed to threads, and what a batch goes through."""

import threading

import numpy as np
import pytest
import torch

from fusion import FusionConfig, fuse
from fusion.frame_solver import FrameSolver
from fusion.input_checks import checked
from fusion.parallel import n_threads
from fusion.report import Stopwatch
from render import InputError
from tests.helpers.example_meshes import two_triangles
from tests.helpers.fusion_examples import AROUND, imager_of, inputs_of, true_maps, tube, wrinkled
from tests.helpers.layers import heights, layered

CPU = torch.device("cpu")
SQUARE = imager_of(two_triangles(), (12, 10))
REST = torch.from_numpy(two_triangles().vertices).float()[None]


def solver_of(inputs, threads=1, **options):
    given = checked(inputs, SQUARE)
    solver = FrameSolver(SQUARE, given, FusionConfig(**options), CPU, threads=threads, weighted=False)
    return solver, given


def test_results_come_in_order_however_long_each_takes_and_no_batch_is_fetched_too_early(monkeypatch):
    """The first of five batches waits until another thread has solved the second."""
    batches = [inputs_of(initial=REST + k) for k in range(5)]
    solver, _ = solver_of(batches[0], threads=2)
    second, fetched, names, whole = threading.Event(), [], set(), solver.solve

    def solve(batch, watch):
        names.add(threading.current_thread().name)
        assert n_threads() == torch.get_num_threads() == 1
        number = round(float(batch.initial[0, 0, 0] + 0.5))
        if number == 0:
            assert second.wait(60)
        result = whole(batch, watch)
        if number == 1:
            second.set()
        return result

    monkeypatch.setattr(solver, "solve", solve)

    def coming():
        for batch in batches:
            fetched.append(batch)
            yield checked(batch, SQUARE)

    results = solver.solve_all(coming(), Stopwatch(CPU))
    first = next(results)
    assert len(fetched) == 3  # one for each thread, and one that waits
    found = [first, *results]
    for number, result in enumerate(found):
        np.testing.assert_array_equal(result.initial, REST + number)
    assert len(names) == 2
    assert threading.current_thread().name not in names


def test_what_is_wrong_with_a_batch_that_is_fetched_late_is_raised_and_ends_the_threads():
    solver, good = solver_of(inputs_of(initial=REST), threads=2)

    def coming():
        yield good
        yield good
        raise InputError("maps: frame 2 is damaged")

    before = threading.active_count()
    with pytest.raises(InputError, match="frame 2 is damaged"):
        list(solver.solve_all(coming(), Stopwatch(CPU)))
    assert threading.active_count() == before


def test_vertices_that_are_no_longer_finite_are_named_by_the_clip_s_frame(monkeypatch):
    solver, given = solver_of(inputs_of(initial=REST.repeat(4, 1, 1)).part(slice(2, 4)))
    readings = solver._readings(given, None)
    readings.vertices[1, 3, 0] = torch.nan
    monkeypatch.setattr(solver, "_readings", lambda inputs, judged: readings)
    with pytest.raises(InputError, match=r"fuse: the result: frame 3, vertex 3 is .*not finite"):
        solver.solve(given, Stopwatch(CPU))


def test_a_batch_tells_what_was_not_read_and_how_long_each_stage_took():
    watch = Stopwatch(CPU)
    solver, given = solver_of(inputs_of(initial=REST.repeat(2, 1, 1)))
    result = solver.solve(given, watch)
    np.testing.assert_array_equal(result.unseen, 1 - SQUARE.visible.any(0).mean())
    assert result.vertices.dtype == result.initial.dtype == np.float32
    assert result.vertices.flags.c_contiguous
    assert (result.stages, result.inside) == ({}, None)
    assert set(watch.seconds) == {"start", "crossings"}


@pytest.mark.parametrize("batch", [2, 4])
def test_confidence_counts_the_same_however_many_frames_are_solved_at_once(batch):
    """Each frame's vertices were held to their readings by 1 / the number seen in the whole batch: here by 2.5 mm."""
    imager = imager_of(tube())
    positions, _ = true_maps(imager, wrinkled(tube(), 4))
    noise = torch.randn(positions.shape, generator=torch.Generator().manual_seed(0))
    inputs = inputs_of(positions=positions + 0.003 * noise, confidence=np.full(positions.shape[:4], 0.5))
    alone, together = (
        fuse(imager, inputs, FusionConfig(batch_frames=frames, weight_displacement=2.0)).vertices
        for frames in (1, batch)
    )
    np.testing.assert_allclose(together, alone, atol=1e-5)


def test_pins_take_their_places_before_the_first_stage():
    wanted = torch.tensor([[[0.1, 0.2, 0.3]], [[0.4, 0.5, 0.6]]])
    solver, given = solver_of(inputs_of(initial=REST.repeat(2, 1, 1), pins=(np.array([2]), wanted)))
    result = solver.solve(given, Stopwatch(CPU))
    np.testing.assert_array_equal(result.initial[:, [2]], wanted)
    np.testing.assert_array_equal(result.initial[:, [0, 1, 3]], REST[:, [0, 1, 3]].repeat(2, 1, 1))
    assert torch.equal(given.initial, REST.repeat(2, 1, 1))  # what was given is not written into


def test_a_garment_is_lifted_off_the_one_beneath_by_what_is_missing():
    """A square worn over a square 1 cm behind it that is 4 mm thick: 7 mm of clearance lift it by 1 mm."""
    inner = (REST - torch.tensor([0, 0, 0.01]), two_triangles().faces)
    config = {"inner_margin_m": 0.004, "clearance_m": 0.007, "normal_iterations": 0}
    middle = 0.5 * REST  # inside the rim, past which nothing is covered
    solver, given = solver_of(inputs_of(initial=middle, inner=inner), **config)
    result = solver.solve(given, Stopwatch(CPU))
    np.testing.assert_allclose(result.vertices[..., 2], 0.001, atol=1e-5)
    assert [float(part[0]) for part in result.inside] == [0, 0]


@pytest.mark.parametrize("normals", [False, True])
def test_a_lining_that_no_view_sees_stays_inside_through_both_stages_and_pinned_parts_of_it_where_they_are(
    normals,
):
    mesh, copies = layered(-0.005)
    imager = imager_of(mesh, (64, 64))
    assert not imager.visible[:, copies].any()
    outer = np.arange(len(tube().vertices)).reshape(-1, AROUND)[3:14].ravel()
    waves = wrinkled(tube(), 2)
    garment = torch.cat([waves, waves[:, outer]], 1)  # what the lining's vertices are makes no difference
    positions, target = true_maps(imager, garment)
    positions = positions + 0.004 * torch.randn(positions.shape, generator=torch.Generator().manual_seed(0))
    pinned = np.array([int(copies.argmax())])
    place = np.full((2, 1, 3), 0.3, np.float32)
    maps = {"positions": positions, "normals": target if normals else None}
    free, held = (fuse(imager, inputs_of(**maps, pins=pins)).vertices for pins in (None, (pinned, place)))
    for frame in free:
        height = heights(frame, outer, copies)
        assert height.min() > -0.009
        assert height.max() < -0.001
    np.testing.assert_array_equal(held[:, pinned], place)
