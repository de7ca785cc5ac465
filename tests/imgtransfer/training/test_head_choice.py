"""What counts how much in a kernel head, against planted truths, a plain loop and degenerate samples."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from imgtransfer.network.kernel_ridge import fit_ridge, typical_width
from imgtransfer.training.head_choice import READ, Choice, Networks, _Problem, choose
from imgtransfer.training.head_fit import rings

RINGS = torch.tensor([0, 0, 1, 1, 2])
GROUP = np.arange(60) // 12


def samples(seed: int = 0) -> tuple[Tensor, Tensor]:
    """60 samples of one patch, whose residual depends on the second ring alone."""
    random = np.random.default_rng(seed)
    features = random.normal(size=(60, 1, 5)).astype(np.float32)
    wanted = np.stack([np.sin(features[:, 0, 2]), features[:, 0, 3]], axis=1)
    return torch.from_numpy(features), torch.from_numpy(wanted)


def chosen(features: Tensor, wanted: Tensor, predicted: Tensor | None = None, **changes: Any) -> Choice:
    options: dict[str, Any] = {
        "rings": RINGS,
        "group": GROUP,
        "smoothness": 2.0,
        "ridge": 0.01,
        "steps": 30,
    } | changes
    networks = None if predicted is None else Networks([predicted], options.pop("read", None))
    return choose(features, [wanted], networks, **options)


def test_the_ring_that_tells_most_counts_most() -> None:
    features, wanted = samples()
    before, after = chosen(features, wanted, steps=1), chosen(features, wanted)
    assert after.error < 0.5 * before.error
    assert after.factors[2] == after.factors[3]
    assert after.factors[2] > 2 * after.factors[0]
    assert after.factors[2] > 2 * after.factors[4]
    assert after.reliance == 1


def test_the_first_error_is_that_of_regressions_fitted_to_the_other_groups() -> None:
    features, wanted = samples()
    own, targets = features[:, 0].double().numpy(), wanted.double().numpy()
    fit = fit_ridge(
        own,
        targets,
        support=np.arange(60),
        group=GROUP,
        width=typical_width(own, 2.0),
        ridge=0.01,
    )
    errors = [fit(own[left == GROUP], own, which=1 + left) - targets[left == GROUP] for left in range(5)]
    centred = targets - targets.mean(0)
    expected = np.square(np.concatenate(errors)).sum() / np.square(centred).sum()
    assert chosen(features, wanted, steps=1).error == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("strength", [0.0, 1.0, 3.0])
def test_networks_count_as_much_as_they_are_right(strength: float) -> None:
    """They predict something that the features say nothing of, and as much that is wrong: by least squares so much."""
    features, known = samples()
    random = np.random.default_rng(1)
    unseen, wrong = (torch.from_numpy(random.normal(size=(60, 2))).float() for _ in range(2))
    wanted, predicted = known + strength * unseen, unseen + wrong
    expected = float((wanted * predicted).sum() / predicted.square().sum())
    assert chosen(features, wanted, predicted, steps=60).reliance == pytest.approx(expected, abs=0.1)


def test_networks_do_not_change_what_the_body_is_found_to_say() -> None:
    features, wanted = samples()
    alone = chosen(features, wanted)
    beside = chosen(features, wanted, wanted * 0.5 + 1e-3 * features[:, 0, :2])
    assert torch.allclose(beside.factors, alone.factors, rtol=1e-3)
    assert beside.ridge == pytest.approx(alone.ridge, rel=1e-3)


@pytest.mark.parametrize("reads", [False, True])
def test_what_networks_are_found_to_be_worth_by_a_plain_loop(reads: bool) -> None:
    features, known = samples()
    read = torch.randn(60, 1, 4, generator=torch.Generator().manual_seed(3))
    wanted, predicted = known + read[:, 0, :2], known + 0.5 * read[:, 0, 1:3]
    found = chosen(features, wanted, predicted, read=read if reads else None, steps=1)
    own = features[:, 0].double().numpy()
    length = typical_width(own, 2.0)
    if reads:
        apart = np.square(own[:, None] - own).sum(-1)
        between = torch.cdist(read[:, 0].double(), read[:, 0].double()).square().numpy()
        medians = [np.median(each[np.triu_indices(60, 1)]) for each in (apart, between)]
        own = np.concatenate([own, read[:, 0].numpy() * np.sqrt(READ * medians[0] / medians[1])], axis=1)
    errors = []
    for targets in (wanted, predicted):
        fit = fit_ridge(own, targets.numpy(), support=np.arange(60), group=GROUP, width=length, ridge=0.01)
        parts = [fit(own[left == GROUP], own, which=1 + left) for left in range(5)]
        errors.append(np.concatenate(parts) - targets.double().numpy())
    candidates = np.linspace(0, 2, 2001)
    sums = [np.square(errors[0] - part * errors[1]).sum() for part in candidates]
    assert found.reliance == pytest.approx(candidates[np.argmin(sums)], abs=2e-3)
    centred = wanted.double().numpy() - wanted.double().numpy().mean(0)
    assert found.error == pytest.approx(min(sums) / np.square(centred).sum(), rel=1e-3)


def test_networks_that_predict_nothing_right_do_not_count() -> None:
    features, wanted = samples()
    assert chosen(features, wanted, -wanted).reliance == 0


def test_gradients_of_the_left_out_error() -> None:
    random = torch.Generator().manual_seed(2)
    points = torch.randn(9, 3, dtype=torch.float64, generator=random)
    distances = torch.stack(
        [torch.cdist(points[:, k : k + 1], points[:, k : k + 1]).square() for k in range(3)]
    )
    problem = _Problem(distances, torch.randn(9, 2, dtype=torch.float64, generator=random))
    groups = [torch.arange(k, 9, 3) for k in range(3)]

    def error(logarithms: Tensor, ridge: Tensor) -> Tensor:
        return problem.left_out_error(logarithms.exp(), ridge.exp(), groups)

    start = [torch.zeros(3), torch.tensor(-2.0)]
    assert torch.autograd.gradcheck(error, [value.double().requires_grad_() for value in start])


@pytest.mark.parametrize("changes", [{"steps": 0}, {"group": np.zeros(60, np.int64)}])
def test_nothing_is_chosen_without_steps_or_groups(changes: dict[str, Any]) -> None:
    result = chosen(*samples(), **changes)
    assert (result.factors == 1).all()
    assert (result.ridge, result.reliance) == (0.01, 1.0)


def test_samples_that_are_all_equal_choose_finite_numbers() -> None:
    result = chosen(torch.ones(60, 1, 5), torch.ones(60, 2))
    assert bool(result.factors.isfinite().all())
    assert np.isfinite(result.ridge)


def test_rings_by_hand() -> None:
    """93 places at two times: the centre's three numbers now, then earlier, then the 14 places of the next ring."""
    found = rings(93 * 2 * 3)
    assert found[:12].tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert found[-3:].tolist() == [9, 9, 9]
    assert torch.bincount(found).tolist() == [3, 3, 42, 42, 78, 78, 78, 78, 78, 78]
