"""How much each ring of places and each time counts in the kernel head, and how strongly it is regularised.

What is near the cloth says most where clips are many, what is farther off where they are few, and how far either is to
be trusted differs by garment: nothing of it is set by hand. Clips are left out in groups, and all factors descend the
error of the frames left out, as in `imgtransfer.deformers.pose_regression.selection` for joints. Where the run begins
with trained networks, it is then found how much of their prediction counts beside that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.network.kernel_ridge import typical_distance
from imgtransfer.running.task import in_worker
from imgtransfer.training.left_out import left_out_errors, left_out_residuals, members, principal_components

_PATCHES = 8  # whose errors are descended, evenly spread
_COMPONENTS = 24  # of a patch's residuals that are predicted; they hold nearly all of them
_RATE = 0.15  # of Adam, in logarithms
# Typical squared distance of what networks make of frames, as a part of that of the body's features: chosen by leaving
# clips out.
READ = 0.2
_ROUNDING = 1e-8  # squared errors that are such a part of others are those of numbers, not of predictions


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


@dataclass(frozen=True, eq=False)
class Networks:
    """What trained networks give of n samples in P patches.

    Args:
        predicted: for each patch (n, A), the part of what is wanted that they predict.
        read: (n, P, E) what they make of the frames; None where that is not read.
    """

    predicted: Sequence[Tensor]
    read: Tensor | None = None


@torch.enable_grad()
def choose(
    features: Tensor,
    residuals: Sequence[Tensor],
    networks: Networks | None = None,
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
        residuals: for each patch (n, A), what is wanted.
        networks: what the run begins with, if it does.
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
    patches = list(_problems(features, residuals, networks, rings, smoothness))
    logarithms = torch.zeros(count, dtype=torch.float64, requires_grad=True)
    strength = torch.tensor(float(np.log(ridge)), dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([logarithms, strength], lr=_RATE)
    first = sum(float(patch.wanted.square().sum()) for patch in patches)
    if first == 0:
        return unchanged
    best, weights = unchanged, logarithms.detach().exp()
    bar = tqdm(
        range(steps), desc="what counts", unit="step", leave=False, delay=2, disable=in_worker() or None
    )
    for _ in bar:
        optimizer.zero_grad()
        total = 0.0
        for patch in patches:
            error = patch.left_out_error(logarithms.exp(), strength.exp(), groups) / first
            error.backward()
            total += error.item()
        if total < best.error or best is unchanged:
            weights = logarithms.detach().exp()
            best = Choice(weights.sqrt()[rings].float(), float(strength.detach().exp()), 1.0, total)
        optimizer.step()
    return best if networks is None else _relied_on(best, patches, weights, groups, first)


@torch.no_grad()
def _relied_on(
    choice: Choice, patches: list[_Problem], rings: Tensor, groups: list[Tensor], first: float
) -> Choice:
    """With the part of the networks' prediction beside which the regression errs least, and that error.

    What it errs by is linear in what is wanted: where a part of the prediction is not, so is that part of its errors.
    """
    moments = torch.zeros(2, 2, dtype=torch.float64)
    ridge = torch.tensor(choice.ridge, dtype=torch.float64)
    for patch in patches:
        errors = patch.left_out(rings, ridge, groups)
        moments += torch.einsum("nir,njr->ij", errors, errors)
    if moments[1, 1] <= _ROUNDING * moments[0, 0]:
        return choice
    reliance = max(float(moments[0, 1] / moments[1, 1]), 0.0)
    error = moments[0, 0] - 2 * reliance * moments[0, 1] + reliance**2 * moments[1, 1]
    return replace(choice, reliance=reliance, error=float(error) / first)


@dataclass(frozen=True, eq=False)
class _Problem:
    """One patch: the kernel's distances by ring, (G, n, n), and what is wanted, (n, R).

    Args:
        predicted: what networks give of that, (n, R). read: squared distances (n, n) of what they make of the frames,
            with 1 as the typical one; None where that is not read.
    """

    distances: Tensor
    wanted: Tensor
    predicted: Tensor | None = None
    read: Tensor | None = None

    def left_out_error(self, rings: Tensor, ridge: Tensor, groups: list[Tensor]) -> Tensor:
        """The summed squared errors of all groups, each predicted from the others, by the body alone."""
        return left_out_errors(_kernel(self._apart(rings)), self.wanted, ridge, groups).sum()

    def left_out(self, rings: Tensor, ridge: Tensor, groups: list[Tensor]) -> Tensor:
        """(n, 2, R) what a kernel that also reads networks errs by, of what is wanted and of what they predict."""
        assert self.predicted is not None
        apart = self._apart(rings)
        if self.read is not None:
            apart = apart + READ * typical_distance(apart.numpy()) * self.read
        both = torch.cat([self.wanted, self.predicted], dim=-1)
        return left_out_residuals(_kernel(apart), both, ridge, groups).unflatten(-1, (2, -1))

    def _apart(self, rings: Tensor) -> Tensor:
        return torch.tensordot(rings, self.distances, dims=1)


def _kernel(apart: Tensor) -> Tensor:
    r = (3 * apart + 1e-12).sqrt()
    return (1 + r) * torch.exp(-r)


def _problems(
    features: Tensor,
    residuals: Sequence[Tensor],
    networks: Networks | None,
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
        if networks is None:
            yield _Problem(apart, _components([wanted])[0])
            continue
        own, given = _components([wanted, networks.predicted[patch].double().cpu()])
        read = None if networks.read is None else _typically_one(networks.read[:, patch])
        yield _Problem(apart, own, given, read)


def _typically_one(points: Tensor) -> Tensor:
    squared = _squared_distances(points.double().cpu())
    return squared / typical_distance(squared.numpy())


def _squared_distances(points: Tensor) -> Tensor:
    return torch.cdist(points, points).square()


def _components(parts: list[Tensor]) -> list[Tensor]:
    """Coordinates (n, R) of lists (n, A) of values in their common principal directions."""
    kept = principal_components(torch.cat([part - part.mean(0) for part in parts]), _COMPONENTS)
    return list(kept.split(len(parts[0])))
