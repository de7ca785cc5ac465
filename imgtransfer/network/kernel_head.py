"""A first guess learned in closed form: kernel ridge regression from the body around patches of cloth.

Training it takes a minute where the networks take an hour; they correct what it leaves. For each patch of cloth
(`network.head_patches`) it is told how the body around the patch's centre has moved, in the patch's own axes
(`network.local_view`), perhaps what trained networks make of it (`network.reading`), and predicts the residual to the
first guess, in that guess's axes. What goes in are few
principal directions of the former, what comes out weights of few principal images of the latter; between them stands a
kernel that compares with training frames (`network.kernel_ridge`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.network.head_patches import Patches, mirrored_pixels
from imgtransfer.network.local_view import mirrored_features
from imgtransfer.network.maps import BodyMaps

EARLIER = 0.12  # weight of what was another at earlier times, beside what is now: chosen by leaving clips out
Values = Callable[[Tensor], Tensor]  # (P, B, M) kernel -> (P, B, R) values


class KernelHead(nn.Module):
    """Predicts the residual to the first guess, for one template.

    Args:
        patches: P of them, over the L pixels of the silhouette.
        mask: (S, H, W) bool, the silhouette.
        sizes: of what the training found.

    The buffers are zeros until they are filled: mean (P, F) and axes (P, F, D) of the features, read_mean (P, E) and
    read_axes (P, E, D') of what networks make of the frames, where that is read, support (P, M, D + D'), width (P,),
    weights (P, M, R), offset (P, R), base (L, 6), and the images that the R values of a patch weigh, orthonormal:
    position_basis (Q, 3, A) and normal_basis (Q, 3, R - A), for the Q pixels of all patches, one patch after the other.
    """

    mean: Tensor
    axes: Tensor
    read_mean: Tensor
    read_axes: Tensor
    support: Tensor
    width: Tensor
    weights: Tensor
    offset: Tensor
    base: Tensor
    position_basis: Tensor
    _silhouette: Tensor
    _tokens: Tensor
    _other: Tensor
    normal_basis: Tensor

    def __init__(self, patches: Patches, mask: Tensor, sizes: HeadSizes) -> None:
        super().__init__()
        self.patches, self.sizes = patches, sizes
        for name, shape in buffer_shapes(patches, int(mask.sum()), sizes).items():
            self.register_buffer(name, torch.zeros(shape))
        # Made again from the template, so not stored.
        self.register_buffer("_silhouette", mask.flatten().nonzero()[:, 0], persistent=False)
        self.register_buffer("_tokens", torch.from_numpy(patches.tokens), persistent=False)
        self.register_buffer(
            "_other", torch.from_numpy(mirrored_pixels(mask.cpu().numpy())), persistent=False
        )
        self._views = mask.shape
        self._rows = [int(start) for start in np.cumsum([0, *map(len, patches.pixels)])]

    @property
    def reads(self) -> bool:
        """Whether it is told what networks make of the frames, `read` of `forward`."""
        return self.sizes.read > 0

    def forward(
        self,
        local: Tensor,
        *,
        read: Sequence[Tensor] = (),
        values: Values | None = None,
        mirrored: bool = False,
    ) -> tuple[Tensor, Tensor]:
        """The residuals of B frames.

        Args:
            local: (B, S, rows, columns, K + 1, L, 3), what `LocalView` tells of them.
            read: what networks make of them, and if `mirrored` of the mirrored ones (`reading.read_frames`); for a head
                that `reads`.
            values: (P, B, M) kernel -> (P, B, R), such as of a head that has not seen these frames; this one's if None.
            mirrored: whether to take the mean with what is predicted for the mirrored scene, mirrored back.

        Returns:
            of positions (metres) and of normals, (B, S, H, W, 3) each, in the first guess's axes; 0 off the silhouette.
        """
        # Samples that lie near each other differ by less than bfloat16 tells apart, and large weights of either sign
        # nearly cancel: rounded products put validation clips of T-shirts 1.7 mm farther off.
        with torch.autocast(local.device.type, enabled=False):
            pixels = self._predicted(local.float(), read[0] if self.reads else None, values)
            if mirrored:
                told = mirrored_features(local.float()), read[1] if self.reads else None
                other = self._predicted(*told, values)
                pixels = (pixels + self.mirrored(other)) / 2
            return self._images(pixels)

    def mirrored(self, pixels: Tensor) -> Tensor:
        """Residuals (B, L, 6) of positions and of normals -> those of the mirrored scene."""
        return pixels[:, self._other] * pixels.new_tensor([-1.0, 1.0, 1.0]).repeat(2)

    def _predicted(self, local: Tensor, read: Tensor | None, values: Values | None) -> Tensor:
        """(B, L, 6), the residuals without what `forward` makes of the mirrored scene."""
        features = self.features(head_features(local, read, self._tokens))
        return self._pixels((values or self.values)(self.kernel(features)))

    def features(self, features: Tensor) -> Tensor:
        """(B, P, F + E) -> (P, B, D + D'): in the principal directions."""
        told, read = features.movedim(1, 0).tensor_split([self.sizes.features], dim=-1)
        own = (told - self.mean[:, None]) @ self.axes
        if not self.reads:
            return own
        return torch.cat([own, (read - self.read_mean[:, None]) @ self.read_axes], dim=-1)

    def kernel(self, features: Tensor) -> Tensor:
        """(P, B, D + D') -> (P, B, M), see `kernel_ridge.matern`."""
        squared = features.square().sum(-1)[..., None] + self.support.square().sum(-1)[:, None]
        squared = (squared - 2 * features @ self.support.mT).clamp(min=0)
        r = (squared * (3 / self.width)[:, None, None]).sqrt()
        return (1 + r) * torch.exp(-r)

    def values(self, kernel: Tensor) -> Tensor:
        """(P, B, M) -> (P, B, R)."""
        return kernel @ self.weights + self.offset[:, None]

    def wanted(self, residuals: Tensor) -> Tensor:
        """Residuals (B, L, 6), of positions and of normals -> (P, B, R), the values that come nearest to them."""
        left = residuals - self.base
        parts = []
        for number, at in enumerate(self.patches.pixels):
            own, rows = left[:, torch.from_numpy(at).to(left.device)], self._of_patch(number)
            bases = self.position_basis[rows].flatten(0, 1), self.normal_basis[rows].flatten(0, 1)
            parts.append(
                torch.cat([own[..., :3].flatten(1) @ bases[0], own[..., 3:].flatten(1) @ bases[1]], dim=-1)
            )
        return torch.stack(parts)

    def _of_patch(self, number: int) -> slice:
        """The rows of the bases that are a patch's."""
        return slice(self._rows[number], self._rows[number + 1])

    def _pixels(self, values: Tensor) -> Tensor:
        """(P, B, R) -> (B, L, 6)."""
        count, positions = values.shape[1], self.sizes.position_images
        pixels = self.base.expand(count, -1, -1).clone()
        for number, at in enumerate(self.patches.pixels):
            own, rows = values[number], self._of_patch(number)
            added = torch.cat(
                [
                    (own[:, :positions] @ self.position_basis[rows].flatten(0, 1).T).view(count, -1, 3),
                    (own[:, positions:] @ self.normal_basis[rows].flatten(0, 1).T).view(count, -1, 3),
                ],
                dim=-1,
            )
            blend = torch.from_numpy(self.patches.blend[number]).to(pixels.device)[:, None]
            pixels[:, torch.from_numpy(at).to(pixels.device)] += added * blend
        return pixels

    def _images(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        images = pixels.new_zeros(len(pixels), int(np.prod(self._views)), 6)
        images[:, self._silhouette] = pixels
        first, second = images.unflatten(1, self._views).split(3, dim=-1)
        return first.contiguous(), second.contiguous()


@dataclass(frozen=True)
class HeadSizes:
    """What the training of a head decides of its sizes.

    Args:
        features: F, numbers that tell of the body around a patch. axes: D, principal directions that are kept.
        read: E, numbers that tell what networks make of a patch. read_axes: D', of their principal directions. Both are
            0 where nothing is read.
        support: M, samples that a frame is compared with.
        position_images, normal_images: A and R - A, principal images of the residuals.
    """

    features: int
    axes: int
    read: int
    read_axes: int
    support: int
    position_images: int
    normal_images: int


@dataclass(frozen=True)
class LeftOut:
    """Heads that have not seen some training frames: what the networks learn to correct, as later with new frames.

    Args:
        weights: (G, P, M, R), offsets: (G, P, R), of the heads that have not seen each of G groups of clips.
        group: (T,) int64, of each training frame.
    """

    weights: Tensor
    offsets: Tensor
    group: Tensor

    def tensors(self) -> dict[str, Tensor]:
        """What a training state holds of them."""
        return {"weights": self.weights, "offsets": self.offsets}

    def values(self, kernel: Tensor, index: Tensor) -> Tensor:
        """The values (P, B, R) of frames `index` (B,), from their kernel (P, B, M)."""
        group = self.group[index]
        values = kernel.new_empty(*kernel.shape[:2], self.weights.shape[-1])
        for number in group.unique().tolist():
            own = (group == number).nonzero()[:, 0].to(kernel.device)
            values[:, own] = kernel[:, own] @ self.weights[number] + self.offsets[number][:, None]
        return values


def buffer_shapes(patches: Patches, pixels: int, sizes: HeadSizes) -> dict[str, tuple[int, ...]]:
    """The shapes of a head's buffers by name; see `KernelHead`."""
    count, rows = len(patches.tokens), sum(map(len, patches.pixels))
    values = sizes.position_images + sizes.normal_images
    read = {"read_mean": (count, sizes.read), "read_axes": (count, sizes.read, sizes.read_axes)}
    return {
        **(read if sizes.read else {}),
        "mean": (count, sizes.features),
        "axes": (count, sizes.features, sizes.axes),
        "support": (count, sizes.support, sizes.axes + sizes.read_axes),
        "width": (count,),
        "weights": (count, sizes.support, values),
        "offset": (count, values),
        "base": (pixels, 6),
        "position_basis": (rows, 3, sizes.position_images),
        "normal_basis": (rows, 3, sizes.normal_images),
    }


def sizes_of(tensors: Mapping[str, Tensor]) -> HeadSizes:
    """The sizes that a head's buffers have.

    Raises:
        KeyError, ValueError: one is missing, or of another number of axes.
    """
    _, features, axes = tensors["axes"].shape
    _, read, read_axes = tensors["read_axes"].shape if "read_axes" in tensors else (0, 0, 0)
    _, support, _ = tensors["weights"].shape
    _, _, positions = tensors["position_basis"].shape
    _, _, normals = tensors["normal_basis"].shape
    return HeadSizes(features, axes, read, read_axes, support, positions, normals)


def head_features(local: Tensor, read: Tensor | None, tokens: Tensor) -> Tensor:
    """What a head is told of its patches, whose tokens are `tokens` (P,): the body, without the vertical, and `read`.

    (B, S, rows, columns, K + 1, L, 3) and (B, S, rows, columns, E) -> (B, P, F + E).
    """
    own = local.flatten(1, 3)[:, tokens, :-1]
    told = torch.cat([own[..., :1, :], EARLIER * own[..., 1:, :]], dim=-2).flatten(2)
    return told if read is None else torch.cat([told, read.flatten(1, 3)[:, tokens]], dim=-1)


def corrected(
    head: KernelHead,
    body: BodyMaps,
    *,
    read: Sequence[Tensor] = (),
    values: Values | None = None,
    mirrored: bool = False,
) -> BodyMaps:
    """`body` with the residuals that a head predicts added to the first guess; the rest as of `KernelHead.forward`."""
    guess, local = body.guess, body.local
    assert guess is not None  # the configuration sees to both
    assert local is not None
    positions, normals = head(local, read=read, values=values, mirrored=mirrored)
    better = replace(
        guess,
        positions=guess.positions + guess.turn(positions),
        normals=guess.normals + guess.turn(normals),
    )
    return replace(body, guess=better)
