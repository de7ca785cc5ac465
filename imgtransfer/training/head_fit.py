"""Fits the kernel head of a model to the training frames, before the networks are trained."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from imgtransfer.network import TransferModel
from imgtransfer.network.base import Guess, apply
from imgtransfer.network.config import HeadConfig
from imgtransfer.network.head_patches import Patches, mirrored_pixels, template_patches
from imgtransfer.network.kernel_head import HeadSizes, KernelHead, LeftOut, head_features
from imgtransfer.network.kernel_ridge import fit_ridge, squared_distances, typical_distance, typical_width
from imgtransfer.network.local_view import mirrored_features
from imgtransfer.network.places import ring_of_place
from imgtransfer.running.task import in_worker
from imgtransfer.training.divergence import Diverged
from imgtransfer.training.head_choice import READ, Choice, Networks, choose
from imgtransfer.training.head_frames import HeadFrames
from imgtransfer.training.left_out import left_out_groups
from imgtransfer.training.sampler import Frames
from render import PositionBox, decode_normals
from render.errors import said_by

MOST_FRAMES = 8192  # that are fitted to, evenly spread; each takes some 10 kB
TYPICAL_FRAMES = 128  # that principal directions and images are found from
AXES, POSITION_IMAGES, NORMAL_IMAGES = 64, 16, 8  # more do not lower the error of left-out clips
# Of the kernel's length that the few samples of the choice bear, where all are fitted: chosen by leaving clips out.
SHORTER = 0.5
READ_AXES = (
    64  # of what networks make of frames, where that is read; half as many err by a third of a percent more
)
GROUPS = 5  # of clips, each left out once
_BATCH = 16
_STEPS_BACK = 4

Batch = Callable[[Tensor], HeadFrames]


class HeadFit:
    """The frames of a training as a head is fitted to them.

    Args:
        config: of the head.
        patches: of the template.
        mask: (S, H, W) bool, its silhouette. covered: (S, rows, columns) bool, the tokens that show any of it.
        box: of the encoded positions.
        mirror: whether each frame counts mirrored, too; all views are from the front or the back.
        read: how many numbers it is told of what networks make of a patch; 0 for none.
        batch: training frames by their numbers (B,).
    """

    def __init__(
        self,
        *,
        config: HeadConfig,
        patches: Patches,
        mask: Tensor,
        covered: Tensor,
        box: PositionBox,
        mirror: bool,
        read: int,
        batch: Batch,
    ) -> None:
        self._config, self._patches, self._mask, self._box = config, patches, mask, box
        self._batch, self._mirror, self._read = batch, mirror, read
        self._tokens = torch.from_numpy(patches.tokens).to(mask.device)
        # Patches whose mirror image shows no cloth.
        self._alone = ~covered.flip(-1).flatten()[self._tokens]
        self._other = torch.from_numpy(mirrored_pixels(mask.cpu().numpy())).to(mask.device)

    @torch.no_grad()
    def __call__(
        self,
        typical: Tensor,
        index: Tensor,
        group: Tensor,
        progress: Callable[[list[Tensor]], Iterable[Tensor]] = iter,
    ) -> tuple[KernelHead, LeftOut, Choice]:
        """Fit a head, and one without each group; what was chosen for them.

        Args:
            typical: (A,) int64, frames that directions and images are found from.
            index: (N,) int64, frames to fit to.
            group: (T,) int64, of every training frame, in [0, G): what is left out together.
            progress: wraps batches of `index`, such as tqdm.
        """
        batches = list(index.split(_BATCH))
        head, choice = self._unfitted(typical, group, len(index))
        parts = [self._samples(head, some, choice.reliance) for some in progress(batches)]
        features, values = (torch.cat(of, dim=1).cpu().numpy() for of in zip(*parts, strict=True))
        groups = self._groups(batches, group)
        count = features.shape[1]
        support = np.linspace(0, count - 1, head.sizes.support).round().astype(np.int64)
        fits = [
            fit_ridge(its, wanted, support=support, group=groups, width=float(width), ridge=choice.ridge)
            for its, wanted, width in zip(features, values, head.width, strict=True)
        ]
        head.support.copy_(torch.from_numpy(features[:, support]))
        weights = torch.from_numpy(np.stack([fit.weights for fit in fits], axis=1)).to(head.weights)
        offsets = torch.from_numpy(np.stack([fit.offsets for fit in fits], axis=1)).to(head.offset)
        head.weights.copy_(weights[0])
        head.offset.copy_(offsets[0])
        return head, LeftOut(weights[1:].clone(), offsets[1:].clone(), group), choice

    def _groups(self, batches: Sequence[Tensor], group: Tensor) -> np.ndarray:
        """What samples of batches, see `_seen`, are left out with."""
        return torch.cat([group[some].repeat(1 + self._mirror) for some in batches]).numpy()

    def _unfitted(self, typical: Tensor, group: Tensor, frames: int) -> tuple[KernelHead, Choice]:
        """A head with all but its support: mean and axes of features, base and principal images of residuals."""
        batches = list(typical.split(_BATCH))
        parts = [self._seen(some) for some in batches]
        features, wanted, predicted = (torch.cat(of) for of in zip(*parts, strict=True))
        features, read = features.tensor_split([features.shape[-1] - self._read], dim=-1)
        choice = self._choice(features, read, wanted, predicted, self._groups(batches, group))
        if self._config.choice_steps:  # more samples need the networks less
            choice = replace(choice, reliance=choice.reliance * (len(typical) / frames) ** 0.5)
        residuals, count = wanted - choice.reliance * predicted, len(features)
        sizes = HeadSizes(
            features=features.shape[-1],
            axes=min(AXES, count, features.shape[-1]),
            read=self._read,
            read_axes=min(READ_AXES, count, self._read),
            support=min(self._config.support, frames * (1 + self._mirror)),
            position_images=min(POSITION_IMAGES, count),
            normal_images=min(NORMAL_IMAGES, count),
        )
        head = KernelHead(self._patches, self._mask, sizes).to(self._mask.device)
        head.mean.copy_(_as_stored(features.mean(0)))
        head.base.copy_(residuals.mean(0))
        factors = choice.factors.to(features)[:, None]
        first = 0
        for number, pixels in enumerate(self._patches.pixels):
            own = features[:, number] - head.mean[number]
            head.width[number] = typical_width(_numbers(own), self._length)
            head.axes[number] = _as_stored(factors * principal(own * factors[:, 0], sizes.axes))
            if head.reads:
                head.read_mean[number] = _as_stored(read[:, number].mean(0))
                its = read[:, number] - head.read_mean[number]
                factor = beside(own @ head.axes[number], its)
                head.read_axes[number] = _as_stored(factor * principal(its, sizes.read_axes))
            at = torch.from_numpy(pixels).to(residuals.device)
            left = residuals[:, at] - head.base[at]
            rows = slice(first, first := first + len(pixels))
            for basis, part in ((head.position_basis, left[..., :3]), (head.normal_basis, left[..., 3:])):
                basis[rows] = principal(part.flatten(1), basis.shape[-1]).unflatten(0, (-1, 3))
        return head, choice

    @property
    def _length(self) -> float:
        """Of the kernel, in typical distances between samples."""
        return self._config.smoothness * (SHORTER if self._config.choice_steps else 1)

    def _choice(
        self, features: Tensor, read: Tensor, wanted: Tensor, predicted: Tensor, group: np.ndarray
    ) -> Choice:
        """How much features, regularisation and networks count; positions and normals weigh alike."""
        scale = (
            (wanted - wanted.mean(0)).unflatten(-1, (2, 3)).square().mean((0, 1, 3)).sqrt().clamp(min=1e-9)
        )
        scale = scale.repeat_interleave(3)
        # The mirror image of a patch that has none says nothing.
        told = torch.ones_like(self._alone)
        if self._mirror and not bool(self._alone.all()):
            told = ~self._alone
        at_patches = [at for at, one in zip(self._patches.pixels, told.tolist(), strict=True) if one]
        pixels = [torch.from_numpy(at).to(wanted.device) for at in at_patches]
        networks = None
        if predicted.any():
            given = [(predicted[:, at] / scale).flatten(1) for at in pixels]
            networks = Networks(given, read[:, told] if self._read else None)
        return choose(
            features[:, told],
            [(wanted[:, at] / scale).flatten(1) for at in pixels],
            networks,
            rings=rings(features.shape[-1]),
            group=group,
            smoothness=self._config.smoothness,
            ridge=self._config.ridge,
            steps=self._config.choice_steps,
        )

    def _samples(self, head: KernelHead, index: Tensor, reliance: float) -> tuple[Tensor, Tensor]:
        """Frames, and then the same mirrored: features (P, n, D) and the values wanted (P, n, R)."""
        seen, wanted, predicted = self._seen(index)
        features, values = _as_stored(head.features(seen)), head.wanted(wanted - reliance * predicted)
        if self._mirror:
            for samples in (features, values):
                samples[self._alone, len(index) :] = samples[self._alone, : len(index)]
        return features, values

    def _seen(self, index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Frames, and then the same mirrored: features (n, P, F); residuals (n, L, 6) in the guess's axes, and how much
        of them networks predict.
        """
        its = self._batch(index)
        body, truth, predicted = its.body, its.truth, its.predicted
        assert body.guess is not None  # the configuration sees to both
        assert body.local is not None
        read = its.read or (None, None)
        decoded = self._box.decode(truth.positions), decode_normals(truth.normals)
        wanted = self._from_guess(body.guess, *decoded)
        given = torch.zeros_like(wanted)
        if predicted is not None:
            given = self._from_guess(body.guess, predicted.positions, predicted.normals)
        features = head_features(body.local, read[0], self._tokens)
        if not self._mirror:
            return features, wanted, given
        sign = wanted.new_tensor([-1.0, 1.0, 1.0]).repeat(2)
        mirrored = head_features(mirrored_features(body.local), read[1], self._tokens)
        wanted, given = (torch.cat([images, images[:, self._other] * sign]) for images in (wanted, given))
        return torch.cat([features, mirrored]), wanted, given

    def _from_guess(self, guess: Guess, positions: Tensor, normals: Tensor) -> Tensor:
        """(B, S, H, W, 3) each -> (B, L, 6), from the first guess's to these, in its axes."""
        parts = [turned_back(guess, positions - guess.positions), turned_back(guess, normals - guess.normals)]
        return torch.cat(parts, dim=-1)[:, self._mask]


def fit_head(
    model: TransferModel, frames: Frames, batch: Batch, *, covered: Tensor, mirror: bool, reads: bool
) -> tuple[KernelHead, LeftOut, Choice]:
    """Fit the head of a model to training frames, with a bar.

    Args:
        model: which has none. frames: of the training. batch, covered, mirror: see `HeadFit`.
        reads: whether the head is told what the model's networks make of the frames; they are rounded then.

    Raises:
        Diverged: equations that have no solution, or none of finite numbers.
    """
    if reads:
        for network in (model.position_net, model.normal_net):
            network.load_state_dict({key: _as_stored(value) for key, value in network.state_dict().items()})
    fit = HeadFit(
        config=model.network.head,
        patches=template_patches(
            model.imager, token=model.network.vit.patch, count=model.network.head.patches
        ),
        mask=model.mask,
        covered=covered,
        box=model.box,
        mirror=mirror,
        read=2 * model.network.vit.dim if reads else 0,
        batch=batch,
    )
    bar = partial(tqdm, desc="first guess", unit="batch", leave=False, delay=2, disable=in_worker() or None)
    group = left_out_groups(frames.clip_starts, GROUPS)
    advice = (
        "try another network.head.ridge or network.head.smoothness, or look for faulty clips with "
        "`imgtransfer inspect`"
    )
    try:
        head, left_out, choice = fit(frames.spread(TYPICAL_FRAMES), frames.spread(MOST_FRAMES), group, bar)
    except (np.linalg.LinAlgError, torch.linalg.LinAlgError) as error:
        raise Diverged(f"network.head cannot be fitted ({said_by(error)}); {advice}") from error
    for name, value in (*head.state_dict().items(), *left_out.tensors().items()):
        if not bool(value.isfinite().all()):
            raise Diverged(f"network.head cannot be fitted: its {name} would not be finite; {advice}")
    return head, left_out, choice


def rings(features: int) -> Tensor:
    """(F,) int64, which ring of places and which time each feature of a head tells of: those that count alike."""
    ring = torch.from_numpy(ring_of_place())
    times = features // (3 * len(ring))
    return (ring[:, None] * times + torch.arange(times))[..., None].expand(-1, -1, 3).flatten()


def beside(body: Tensor, read: Tensor) -> float:
    """By what to multiply what networks make of samples (n, E), to stand beside what the body does (n, D): `READ`."""
    distances = [typical_distance(squared_distances(each, each)) for each in (_numbers(body), _numbers(read))]
    return float(np.sqrt(READ * distances[0] / distances[1]))


def turned_back(guess: Guess, vectors: Tensor) -> Tensor:
    """Vectors (..., 3) at the guess's pixels, in the canonical frame's axes -> what `guess.turn` makes them of.

    By Richardson's iteration on the transposed: the axes are nearly orthonormal, and where they are much shorter the
    result stays bounded.
    """
    if guess.rotation is None:
        return vectors
    back = guess.rotation.mT
    result = apply(back, vectors)
    for _ in range(_STEPS_BACK - 1):
        result = result + apply(back, vectors - guess.turn(result))
    return result


def principal(samples: Tensor, count: int) -> Tensor:
    """The orthonormal directions (F, count) along which samples (N, F) of mean 0 vary most; 0 where there are fewer."""
    samples = samples.double()
    _, vectors = torch.linalg.eigh(samples @ samples.T)
    directions = samples.T @ vectors[:, -count:].flip(1)
    length = directions.norm(dim=0)
    kept = length > 1e-6 * length.max().clamp(min=1e-12)
    return torch.where(kept, directions / length, torch.zeros_like(directions)).float()


def _numbers(values: Tensor) -> np.ndarray:
    """On the processor, float64."""
    return values.double().cpu().numpy()


def _as_stored(values: Tensor) -> Tensor:
    """Rounded as the model file may store them, before anything is fitted, so that storing changes nothing."""
    return values.half().float()
