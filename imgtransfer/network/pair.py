"""Both networks of a model on the same frames: by themselves as in the paper, or looking at each other."""

from __future__ import annotations

from torch import Tensor

from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyMaps
from imgtransfer.network.mirror import Garment
from imgtransfer.network.transfer import TransferNet

Network = LocalTransferNet | TransferNet
Pair = tuple[Tensor, Tensor]  # of the position network and of the normal network


def encoded(networks: tuple[Network, Network], garment: Garment, hidden: Pair | None = None) -> Pair:
    """The template's tokens of both networks, for `transferred`.

    Args:
        garment: the template as the networks see it.
        hidden: what their frozen trunks make of it, where that is known (`TrunkCache.template`).
    """
    first, second = networks
    if isinstance(garment, TemplateView):
        assert isinstance(first, LocalTransferNet)
        assert isinstance(second, LocalTransferNet)
        return first.encode(garment), second.encode(garment)
    assert isinstance(first, TransferNet)
    assert isinstance(second, TransferNet)
    known = hidden or (None, None)
    return first.encode(garment.positions, known[0]), second.encode(garment.normals, known[1])


def transferred(
    networks: tuple[Network, Network], body: BodyMaps, garment: Garment, tokens: Pair | None = None
) -> Pair:
    """What the decoders give for B posed bodies, (B, S, H, W, 3) each.

    Args:
        networks: of positions and of normals.
        body: maps of the bodies.
        garment: the template as the networks see it, unless `body` has another in its place.
        tokens: `encoded(networks, garment)` of an earlier call; one for all frames, or one a frame, as of `garment`.
    """
    first, second = networks
    if body.garment is not None:
        garment, tokens = body.garment, None
    known = tokens or encoded(networks, garment)
    if isinstance(garment, TemplateView):
        assert isinstance(first, LocalTransferNet)
        assert isinstance(second, LocalTransferNet)
        return first(garment, body.local, tokens=known[0]), second(garment, body.local, tokens=known[1])
    assert isinstance(first, TransferNet)
    assert isinstance(second, TransferNet)
    hidden, images = body.hidden or (None, None), body.images
    if first.config.attention == "cross_modal":
        seen = (first.encode(images.positions, hidden[0]), second.encode(images.normals, hidden[1]))
        return _looking_at_each_other((first, second), known, seen, body)
    return (
        first(garment.positions, images.positions, garment_tokens=known[0], body_hidden=hidden[0]),
        second(garment.normals, images.normals, garment_tokens=known[1], body_hidden=hidden[1]),
    )


def _looking_at_each_other(
    networks: tuple[TransferNet, TransferNet], garments: Pair, seen: Pair, body: BodyMaps
) -> Pair:
    """The refinement of both networks block by block, each with the other's tokens of the block before (table 4)."""
    first, second = networks
    images = body.images
    tokens = (
        first.begin(garments[0], seen[0], images.positions),
        second.begin(garments[1], seen[1], images.normals),
    )
    for level in range(len(first.refinement)):
        tokens = (
            first.refine(level, tokens[0], seen[0], tokens[1]),
            second.refine(level, tokens[1], seen[1], tokens[0]),
        )
    frames = images.positions.shape[:2]
    return first.decode(tokens[0], frames), second.decode(tokens[1], frames)
