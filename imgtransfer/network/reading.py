"""What trained networks make of the frames that a kernel head predicts: numbers that tell it more than the body alone.

Networks that have seen many garments know which motions of the body move cloth alike. What they predict hangs on those
garments, fabrics and simulator; the tokens that they predict it from can be told to a regression, which finds out from
the clips at hand what they mean there.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.local_view import TemplateView, mirrored_features
from imgtransfer.network.mirror import Garment
from imgtransfer.network.pair import Network, Pair

Version = tuple[Garment, Pair]  # a template as the networks see it, with its tokens


def read_frames(
    networks: tuple[Network, Network], versions: Sequence[Version], local: Tensor | None
) -> tuple[Tensor, ...]:
    """What both networks make of frames, and with two versions of the template of the mirrored ones.

    Args:
        networks: of positions and of normals; local ones.
        versions: of the template, the plain one and perhaps the mirrored one.
        local: (B, S, rows, columns, K + 1, L, 3) float32, what `LocalView` tells of the frames.

    Returns:
        for each version (B, S, rows, columns, E) float32, the tokens that the position network makes its residual of,
        then those of the normal network; 0 for patches without cloth.
    """
    assert local is not None  # the configuration sees to it
    shown = (local, mirrored_features(local)) if len(versions) > 1 else (local,)
    return tuple(_read(networks, *version, its) for version, its in zip(versions, shown, strict=True))


def _read(networks: tuple[Network, Network], garment: Garment, tokens: Pair, local: Tensor) -> Tensor:
    assert isinstance(garment, TemplateView)
    covered, parts = garment.covered[0], []
    for network, known in zip(networks, tokens, strict=True):
        assert isinstance(network, LocalTransferNet)  # the configuration sees to it
        parts.append(network.refined(known, local[:, covered]))
    refined = torch.cat(parts, dim=-1).float()
    grid = refined.new_zeros(len(local), *covered.shape, refined.shape[-1])
    grid[:, covered] = refined
    return grid
