"""Kernel ridge regression against hand-computed values, its definition in plain loops, and its laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imgtransfer.network.kernel_ridge import fit_ridge, matern, squared_distances, typical_width


def samples(count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    features = random.normal(size=(count, 3))
    return features, np.stack([np.sin(features[:, 0]), features[:, 1] * features[:, 2]], axis=1) + 5


def everything(count: int) -> dict[str, np.ndarray]:
    return {"support": np.arange(count), "group": np.arange(count) * 4 // count}


def test_two_samples_by_hand() -> None:
    """One apart: the typical squared distance is 1, so with smoothness 1 the width is 2."""
    fit = fit_ridge(
        np.array([[0.0], [1.0]]),
        np.array([[1.0], [3.0]]),
        support=np.arange(2),
        group=np.zeros(2, np.int64),
        width=typical_width(np.array([[0.0], [1.0]]), smoothness=1.0),
        ridge=0.5,
    )
    r = math.sqrt(1.5)
    k = (1 + r) * math.exp(-r)
    assert fit.width == pytest.approx(2)
    # Targets -1 and 1 about the mean 2 are an eigenvector of the kernel matrix, of eigenvalue 1 - k.
    np.testing.assert_allclose(fit.weights[0, :, 0], np.array([-1, 1]) / (1 - k + 0.5), rtol=1e-6)
    np.testing.assert_allclose(fit.offsets[0], 2)


def test_plain_loops_give_the_same() -> None:
    features, targets = samples(20)
    fit = fit_ridge(features, targets, **everything(20), width=typical_width(features, 1.5), ridge=0.01)
    pairs = [
        sum((a - b) ** 2 for a, b in zip(features[i], features[j], strict=True))
        for i in range(20)
        for j in range(i)
    ]
    width = 2 * 1.5**2 * float(np.median(pairs))

    def kernel(a: np.ndarray, b: np.ndarray) -> float:
        r = math.sqrt(3 * sum((x - y) ** 2 for x, y in zip(a, b, strict=True)) / width)
        return (1 + r) * math.exp(-r)

    matrix = np.array([[kernel(a, b) for b in features] for a in features])
    weights = np.linalg.solve(matrix + 0.01 * np.eye(20), targets - targets.mean(0))
    new = np.random.default_rng(4).normal(size=(5, 3))
    expected = [sum(kernel(x, features[i]) * weights[i] for i in range(20)) + targets.mean(0) for x in new]
    np.testing.assert_allclose(fit(new, features), expected, rtol=0, atol=1e-5)


def test_without_regularisation_the_samples_are_met() -> None:
    features, targets = samples()
    fit = fit_ridge(features, targets, **everything(40), width=typical_width(features, 1.0), ridge=1e-9)
    np.testing.assert_allclose(fit(features, features), targets, rtol=0, atol=1e-5)


def test_some_samples_as_support_minimise_what_they_shall() -> None:
    """Any other sum of kernels at the support has larger errors at all samples and norm together."""
    features, targets = samples()
    chosen = everything(40) | {"support": np.arange(0, 40, 4)}
    fit = fit_ridge(features, targets, **chosen, width=typical_width(features, 1.0), ridge=0.1)
    centres = features[chosen["support"]]
    own = matern(squared_distances(centres, centres), fit.width)
    kernel = matern(squared_distances(features, centres), fit.width)

    def cost(weights: np.ndarray) -> float:
        errors = kernel @ weights + fit.offsets[0] - targets
        return float(np.square(errors).sum() + 0.1 * (weights * (own @ weights)).sum())

    random = np.random.default_rng(5)
    least = cost(fit.weights[0])
    assert all(cost(fit.weights[0] + 1e-3 * random.normal(size=(10, 2))) > least for _ in range(20))


def test_a_group_left_out_has_no_influence_and_the_rest_is_fitted_as_if_it_were_not_there() -> None:
    features, targets = samples()
    options = everything(40)
    outside = options["group"] != 2
    fit = fit_ridge(features, targets, **options, width=typical_width(features, 1.0), ridge=0.01)
    changed = np.where(outside[:, None], targets, 1e3)
    again = fit_ridge(features, changed, **options, width=typical_width(features, 1.0), ridge=0.01)
    np.testing.assert_allclose(again.weights[3], fit.weights[3], rtol=1e-9)
    np.testing.assert_array_equal(again.offsets[3], fit.offsets[3])
    assert np.abs(again.weights[0] - fit.weights[0]).max() > 1
    centred = targets[outside] - targets[outside].mean(0)
    kernel = matern(squared_distances(features[outside], features[outside]), fit.width)
    weights = np.linalg.solve(kernel + 0.01 * np.eye(30), centred)
    new = np.random.default_rng(6).normal(size=(5, 3))
    expected = matern(squared_distances(new, features[outside]), fit.width) @ weights + targets[outside].mean(
        0
    )
    np.testing.assert_allclose(fit(new, features, which=3), expected, rtol=0, atol=1e-5)


def test_samples_that_are_all_equal_give_their_mean() -> None:
    features, targets = np.ones((6, 2)), np.arange(6.0)[:, None]
    fit = fit_ridge(features, targets, **everything(6), width=typical_width(features, 1.0), ridge=1e-3)
    np.testing.assert_allclose(fit(features[:1], features), [[2.5]], atol=1e-6)


def test_a_batch_equals_its_singles() -> None:
    features, targets = samples()
    fit = fit_ridge(features, targets, **everything(40), width=typical_width(features, 1.0), ridge=0.01)
    singles = np.concatenate([fit(features[k : k + 1], features) for k in range(4)])
    np.testing.assert_allclose(fit(features[:4], features), singles, rtol=1e-9)
