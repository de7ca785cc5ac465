"""The transfer network by itself: shapes, what influences what."""

from __future__ import annotations

import pytest
import torch
from pydantic import ValidationError

from imgtransfer.network import EncoderConfig, NetworkConfig, TransferNet
from imgtransfer.network.attention import Attention, sine_cosine_grid
from imgtransfer.network.decoder import DecoderBlock
from render import InputError

SIZE = (32, 48)  # not square: a swap of height and width fails


def small(**switches: object) -> NetworkConfig:
    return NetworkConfig(
        encoder=EncoderConfig(patch=8, dim=16, depth=2, heads=2), blocks=2, heads=4, **switches
    )


def network(**switches: object) -> TransferNet:
    """A small network whose last layer does not start at 0, so that its inputs matter."""
    torch.manual_seed(0)
    net = TransferNet(small(**switches), SIZE)
    for parameter in net.decoder.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    return net.eval()


def images(batch: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(batch, 2, *SIZE, 3, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("shortcuts", [False, True])
@pytest.mark.parametrize("garments", [1, 3])
def test_output_has_the_bodies_shape(shortcuts: bool, garments: int) -> None:
    net = network(shortcuts=shortcuts)
    assert net(images(garments), images(3, seed=1)).shape == (3, 2, *SIZE, 3)
    assert net.encoder.grid == (4, 6)
    assert net.encode(images(3)).shape == (3, 2, 1 + 4 * 6, 16)


@pytest.mark.parametrize("patch", [4, 8, 16])
def test_decoder_blocks_follow_the_patch(patch: int) -> None:
    net = TransferNet(
        NetworkConfig(encoder=EncoderConfig(patch=patch, dim=32, depth=1, heads=2), blocks=1), SIZE
    )
    assert 2 ** len(net.decoder.blocks) == patch
    assert net(images(1), images(1)).shape == (1, 2, *SIZE, 3)


def test_a_decoder_block_halves_features_and_doubles_resolution() -> None:
    assert DecoderBlock(12)(torch.zeros(1, 12, 3, 5)).shape == (1, 6, 6, 10)


def test_size_that_is_no_multiple_of_the_patch_is_refused() -> None:
    with pytest.raises(InputError, match=r"30x48 .height x width., not a multiple of the 8-pixel patch"):
        TransferNet(small(), (30, 48))


def test_images_of_another_size_are_refused() -> None:
    with pytest.raises(InputError, match=r"images are 48x32 .* made for 32x48"):
        network()(images(1).mT.movedim(-2, -1).transpose(2, 3), images(1).transpose(2, 3))


@pytest.mark.parametrize("shortcuts", [False, True])
def test_a_change_of_the_body_changes_the_output(shortcuts: bool) -> None:
    net, garment, body = network(shortcuts=shortcuts), images(1), images(1, seed=1)
    other = body.clone()
    other[:, 0, 8:16, 8:16] += 0.5
    before, after = net(garment, body), net(garment, other)
    assert (after - before)[:, 0].abs().max() > 1e-4
    # far from the change too: attention reaches every patch
    assert (after - before)[:, 0, 24:, 40:].abs().max() > 1e-6


@pytest.mark.parametrize("shortcuts", [False, True])
def test_views_do_not_leak_into_each_other(shortcuts: bool) -> None:
    net, garment, body = network(shortcuts=shortcuts), images(1), images(2, seed=1)
    other = body.clone()
    other[:, 1] = torch.rand(other[:, 1].shape)
    before, after = net(garment, body), net(garment, other)
    assert torch.equal(before[:, 0], after[:, 0])
    assert not torch.allclose(before[:, 1], after[:, 1])


@pytest.mark.parametrize("shortcuts", [False, True])
def test_a_batch_equals_its_frames(shortcuts: bool) -> None:
    net, garment, body = network(shortcuts=shortcuts), images(1), images(3, seed=1)
    singles = torch.cat([net(garment, frame[None]) for frame in body])
    torch.testing.assert_close(net(garment, body), singles, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("shortcuts", [False, True])
def test_cached_garment_tokens_equal_recomputed_ones(shortcuts: bool) -> None:
    net, garment, body = network(shortcuts=shortcuts), images(1), images(3, seed=1)
    torch.testing.assert_close(
        net(garment, body, garment_tokens=net.encode(garment)), net(garment, body), rtol=0, atol=0
    )


@pytest.mark.parametrize("shortcuts", [False, True])
def test_a_residual_network_starts_at_zero(shortcuts: bool) -> None:
    net = TransferNet(small(target="residual", shortcuts=shortcuts), SIZE)
    assert net(images(1), images(2)).abs().max() == 0


def test_the_body_enters_cross_attention_unnormalised() -> None:  # equation 9: Cross(Norm(F_g), F_b, F_b)
    block = network().refinement[0]
    garment, body = torch.randn(1, 5, 16), torch.randn(1, 7, 16)
    assert not torch.allclose(block(garment, body), block(garment, 3 * body))


def test_attention_equals_a_plain_loop() -> None:
    torch.manual_seed(0)
    layer, tokens, context = Attention(8, 2), torch.randn(1, 3, 8), torch.randn(1, 4, 8)
    query, (key, value) = layer.query(tokens)[0], layer.key_value(context)[0].chunk(2, dim=-1)
    rows = []
    for token in range(3):
        heads = []
        for head in (slice(0, 4), slice(4, 8)):
            weights = torch.softmax(torch.stack([query[token, head] @ k[head] for k in key]) / 2, dim=0)
            heads.append(sum(w * v[head] for w, v in zip(weights, value, strict=True)))
        rows.append(torch.cat(heads))
    torch.testing.assert_close(layer(tokens, context)[0], layer.output(torch.stack(rows)))


def test_position_embedding_counts_rows_first() -> None:
    embedding = sine_cosine_grid((2, 3), 8).unflatten(0, (2, 3))
    assert torch.equal(embedding[0, :, :4], embedding[0, :1, :4].expand(3, 4))  # one row, one first half
    assert embedding[1, 0, 0] == torch.tensor(1.0).sin()
    assert embedding[0, 2, 4] == torch.tensor(2.0).sin()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"encoder": {"dim": 20, "heads": 4, "patch": 16}}, "multiple of heads .4., and of patch .16."),
        ({"encoder": {"dim": 48, "heads": 4, "patch": 16}, "heads": 5}, "multiple of heads .5."),
        ({"frame": "body"}, "frame: body needs target: residual"),
        ({"encoder": {"kind": "resnet"}}, "vit"),
        ({"depth": 3}, "Extra inputs"),
    ],
)
def test_impossible_sizes_are_refused(change: dict, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        NetworkConfig.model_validate(change)
