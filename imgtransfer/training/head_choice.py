"""How much each ring of places and each time counts in the kernel head, and how strongly it is regularised.

What is near the cloth says most where clips are many, what is farther off where they are few, and how far either is to
be trusted differs by garment: nothing of it is set by hand. Clips are left out in groups, and all factors descend the
error of the frames left out, as in `imgtransfer.deformers.pose_regression.selection` for joints. Where the run begins
with trained networks, how much of their prediction counts is found with the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.network.kernel_ridge import typical_distance
from imgtransfer.running.task import in_worker
from imgtransfer.training.left_out import left_out_errors, members, principal_components

_PATCHES = 8  # whose errors are descended, evenly spread
_COMPONENTS = 24  # of a patch's residuals that are predicted; they hold nearly all of them
_RATE = 0.15  # of Adam, in logarithms
_RELIANCE_RATE = 0.03  # the same for the part of the networks' prediction that counts


@dataclass(frozen=True, eq=False)
class Choice:
    """What was chosen.

    Args:
        factors: (F,) float32, by which features are multiplied.
        ridge: strength of the regularisation.
        reliance: the part of the networks' prediction that counts; 1 where there is none.
        error: of the frames left out, squared, as a part of what the first guess leaves.
    """

    factors: Tensor
    ridge: float
    reliance: float
    error: float


@torch.enable_grad()
def choose(
    features: Tensor,
    residuals: Sequence[Tensor],
    predicted: Sequence[Tensor] | None,
    *,
    rings: Tensor,
    group: np.ndarray,
    smoothness: float,
    ridge: float,
    steps: int,
) -> Choice:
    """Descend the error of frames that are left out, from a kernel that treats all features alike.

    Args:
        features: (n, P, F) of n samples in P patches.
        residuals: for each patch (n, A), what is wanted. predicted: the part of it that the networks give, or None.
        rings: (F,) int64 in [0, G), features that count alike.
        group: (n,) int, samples that are left out together; with less than two groups nothing is chosen.
        smoothness: the kernel's length in typical distances between samples. ridge: the first strength.
        steps: of the descent; 0 changes nothing.
    """
    count = int(rings.max()) + 1
    unchanged = Choice(torch.ones(len(rings)), ridge, 1.0, 1.0)
    groups = members(group)
    if steps == 0 or len(groups) < 2:
        return unchanged
    patches = list(_problems(features, residuals, predicted, rings, smoothness))
    logarithms = torch.zeros(count, dtype=torch.float64, requires_grad=True)
    strength = torch.tensor(float(np.log(ridge)), dtype=torch.float64, requires_grad=True)
    reliance = torch.ones((), dtype=torch.float64, requires_grad=predicted is not None)
    rates = [{"params": [logarithms, strength], "lr": _RATE}, {"params": [reliance], "lr": _RELIANCE_RATE}]
    optimizer = torch.optim.Adam(rates)
    first = sum(float(patch.wanted.square().sum()) for patch in patches)
    if first == 0:
        return unchanged
    best = unchanged
    bar = tqdm(
        range(steps), desc="what counts", unit="step", leave=False, delay=2, disable=in_worker() or None
    )
    for _ in bar:
        optimizer.zero_grad()
        total = 0.0
        for patch in patches:
            error = patch.left_out_error(logarithms.exp(), strength.exp(), reliance, groups) / first
            error.backward()
            total += error.item()
        if total < best.error or best is unchanged:
            factors = (logarithms.detach() / 2).exp()[rings].float()
            best = Choice(factors, float(strength.detach().exp()), float(reliance.detach()), total)
        optimizer.step()
    return best


@dataclass(frozen=True, eq=False)
class _Problem:
    """One patch: the kernel's distances by ring, (G, n, n); what is wanted and what networks give of it, (n, R)."""

    distances: Tensor
    wanted: Tensor
    predicted: Tensor | None

    def left_out_error(self, rings: Tensor, ridge: Tensor, reliance: Tensor, groups: list[Tensor]) -> Tensor:
        """The summed squared errors of all groups, each predicted from the others."""
        r = (3 * torch.tensordot(rings, self.distances, dims=1) + 1e-12).sqrt()
        targets = self.wanted if self.predicted is None else self.wanted - reliance * self.predicted
        return left_out_errors((1 + r) * torch.exp(-r), targets, ridge, groups).sum()


def _problems(
    features: Tensor,
    residuals: Sequence[Tensor],
    predicted: Sequence[Tensor] | None,
    rings: Tensor,
    smoothness: float,
) -> Iterator[_Problem]:
    count = features.shape[1]
    for patch in np.unique(np.linspace(0, count - 1, min(_PATCHES, count)).round().astype(int)):
        own = features[:, patch].double().cpu()
        apart = torch.stack(
            [_squared_distances(own[:, rings == ring]) for ring in range(int(rings.max()) + 1)]
        )
        apart /= typical_distance(apart.sum(0).numpy()) * 2 * smoothness**2
        wanted = residuals[patch].double().cpu()
        both = [wanted] if predicted is None else [wanted, predicted[patch].double().cpu()]
        yield _Problem(apart, *_components(both))


def _squared_distances(points: Tensor) -> Tensor:
    return torch.cdist(points, points).square()


def _components(parts: list[Tensor]) -> tuple[Tensor, Tensor | None]:
    """Coordinates (n, R) of one or two lists (n, A) of values in their common principal directions."""
    kept = principal_components(torch.cat([part - part.mean(0) for part in parts]), _COMPONENTS)
    first, *second = kept.split(len(parts[0]))
    return first, second[0] if second else None
