"""Work shared out over threads: the same numbers, whatever their count."""

import numpy as np
import pytest
import torch
from fusion_examples import cylinder_body, tube, wrinkled

from fusion import BodySdf, Topology, parallel, recorder
from fusion.energy import Energy
from fusion.parallel import n_threads, one_torch_thread, run_all


@pytest.fixture(params=[1, 2, 3])
def threads(request, monkeypatch):
    monkeypatch.setattr(recorder, "_WORTH_A_THREAD", 1)
    monkeypatch.setattr("fusion.moving_mesh._WORTH_A_THREAD", 1)
    token = parallel._threads.set(request.param)
    yield request.param
    parallel._threads.reset(token)


def evaluated():
    topology = Topology(tube())
    vertices = wrinkled(tube(), 5)
    share = torch.full((1, topology.n_vertices), 1 / topology.n_vertices)
    weights = {"edge_length_m2": 3.0, "displacement_m2": 2.0, "normal_consistency": 0.5}
    energy = Energy(topology, weights, vertices, share)
    energy.vertices.copy_(vertices + 0.001 * torch.sin(1000 * vertices))
    return energy.evaluate(), energy.gradient


def test_the_objective_does_not_depend_on_the_number_of_threads(threads):
    found = evaluated()
    token = parallel._threads.set(1)
    want = evaluated()
    parallel._threads.reset(token)
    assert torch.equal(found[0], want[0])
    assert torch.equal(found[1], want[1])


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
