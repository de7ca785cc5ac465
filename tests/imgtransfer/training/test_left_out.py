"""What is left out together, and what a fit to the rest errs by, against a plain loop and closed-form fits."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from imgtransfer.network.kernel_ridge import fit_ridge, matern, squared_distances
from imgtransfer.training.left_out import (
    left_out_errors,
    left_out_groups,
    members,
    principal_components,
)


def test_groups_are_of_whole_clips_or_of_parts_of_a_single_one() -> None:
    starts = np.repeat([0, 4, 6, 14], [4, 2, 8, 2])  # middles at 2, 5, 10 and 15 of 16 frames
    assert left_out_groups(starts, 2).tolist() == [0] * 6 + [1] * 10
    assert left_out_groups(starts, 4).tolist() == [0] * 4 + [1] * 2 + [2] * 8 + [3] * 2
    assert left_out_groups(np.zeros(6, np.int64), 3).tolist() == [0, 0, 1, 1, 2, 2]
    assert left_out_groups(np.zeros(1, np.int64), 3).tolist() == [0]


def test_members_are_in_the_order_of_their_groups() -> None:
    assert [found.tolist() for found in members(np.array([4, 1, 4, 2]))] == [[1], [3], [0, 2]]


def test_one_of_two_samples_is_predicted_by_the_other() -> None:
    """By its target, whatever the kernel: nothing is left of the other about their mean."""
    errors = left_out_errors(
        torch.tensor([[1.0, 0.3], [0.3, 1.0]]).double(),
        torch.tensor([[1.0, 0.0], [4.0, 2.0]]).double(),
        torch.tensor(0.1).double(),
        [torch.tensor([0]), torch.tensor([1])],
    )
    torch.testing.assert_close(errors, torch.tensor([13.0, 13.0]).double())


def test_errors_are_those_of_fits_to_the_other_groups() -> None:
    random = np.random.default_rng(0)
    features, targets, group = random.normal(size=(12, 2)), random.normal(size=(12, 3)), np.arange(12) % 3
    kernel = matern(squared_distances(features, features), 2.0)
    found = left_out_errors(
        torch.from_numpy(kernel), torch.from_numpy(targets), torch.tensor(0.2).double(), members(group)
    )
    fit = fit_ridge(features, targets, support=np.arange(12), group=group, width=2.0, ridge=0.2)
    for number in range(3):
        own = group == number
        error = np.square(fit(features[own], features, which=1 + number) - targets[own]).sum()
        assert found[number].item() == pytest.approx(error, rel=1e-6)


def test_components_keep_distances_and_come_in_ascending_order() -> None:
    samples = torch.randn(6, 40, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    centred = samples - samples.mean(0)
    found = principal_components(centred, 10)
    torch.testing.assert_close(torch.cdist(found, found), torch.cdist(samples, samples))
    assert (found.square().sum(0).diff() >= -1e-9).all()
    assert principal_components(centred, 2).shape == (6, 2)
