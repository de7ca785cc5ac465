"""The decoder: equations 12 and 13 written out, resolutions, start values."""

from __future__ import annotations

import pytest
import torch
from torch.nn import functional

from imgtransfer.network.decoder import Decoder, DecoderBlock


def features(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed))


def decoder(*, linear: bool = False, zero_start: bool = False) -> Decoder:
    torch.manual_seed(0)
    return Decoder(dim=16, blocks=3, linear=linear, zero_start=zero_start)


def test_a_block_is_what_the_equations_say() -> None:
    torch.manual_seed(0)
    block, given = DecoderBlock(6), features(2, 6, 4, 5)

    def swish(x: torch.Tensor) -> torch.Tensor:
        return x / (1 + torch.exp(-x))

    def convolved(x: torch.Tensor, layer: torch.nn.Conv2d) -> torch.Tensor:
        """A 3 x 3 convolution as a sum over its nine places."""
        padded = functional.pad(x, (1, 1, 1, 1))
        height, width = x.shape[-2:]
        total = layer.bias[:, None, None] if layer.bias is not None else torch.zeros(())
        for row in range(3):
            for column in range(3):
                part = padded[..., row : row + height, column : column + width]
                total = total + torch.einsum("oi,bihw->bohw", layer.weight[..., row, column], part)
        return total

    inner = convolved(swish(given), block.conv3)  # equation 12
    wanted = block.upsample(
        convolved(given, block.conv1) + convolved(swish(inner), block.conv2)
    )  # equation 13
    torch.testing.assert_close(block(given), wanted, rtol=1e-4, atol=1e-5)


def test_a_block_keeps_about_the_signals_variance() -> None:
    torch.manual_seed(0)
    given = features(4, 64, 16, 16)
    for seed in range(3):
        torch.manual_seed(seed)
        inside = DecoderBlock(64)(given)[..., 4:-4, 4:-4]
        assert 0.6 < inside.std() / given.std() < 1.5


def test_upsampling_a_constant_leaves_no_chequerboard() -> None:
    torch.manual_seed(0)
    block = DecoderBlock(4)
    torch.nn.init.ones_(block.upsample.weight)
    flat = block.upsample(torch.ones(1, 2, 6, 6))[..., 2:-2, 2:-2]
    torch.testing.assert_close(flat, flat[..., :1, :1].expand_as(flat))


@pytest.mark.parametrize("linear", [False, True])
def test_the_image_is_a_patch_for_every_token(linear: bool) -> None:
    net = decoder(linear=linear)
    assert net(features(2, 16, 3, 5)).shape == (2, 3, 24, 40)
    assert [block.conv1.in_channels for block in net.blocks] == [16, 8, 4]


@pytest.mark.parametrize("linear", [False, True])
def test_a_start_at_zero_is_zero_and_can_leave_it(linear: bool) -> None:
    net = decoder(linear=linear, zero_start=True)
    image = net(features(1, 16, 2, 2))
    assert image.abs().max() == 0
    (image - 1).square().sum().backward()
    assert net.to_image.weight.grad is not None
    assert net.to_image.weight.grad.abs().max() > 0
    if net.linear is not None:
        assert net.linear.weight.grad is not None
        assert net.linear.weight.grad.abs().max() > 0


def test_the_linear_map_adds_each_tokens_own_patch() -> None:
    net = decoder(linear=True)
    assert net.linear is not None
    given = features(1, 16, 2, 3)
    without = decoder(linear=True)
    without.load_state_dict(net.state_dict())
    assert without.linear is not None
    torch.nn.init.zeros_(without.linear.weight)
    torch.nn.init.zeros_(without.linear.bias)
    added = net(given) - without(given)
    for row in range(2):
        for column in range(3):
            patch = torch.einsum("i,iohw->ohw", given[0, :, row, column], net.linear.weight)
            patch = patch + net.linear.bias[:, None, None]
            place = added[0, :, 8 * row : 8 * row + 8, 8 * column : 8 * column + 8]
            torch.testing.assert_close(place, patch, rtol=1e-4, atol=1e-5)


def test_the_memorys_layout_changes_nothing() -> None:
    net, given = decoder(), features(2, 16, 3, 5)
    torch.testing.assert_close(net(given.contiguous(memory_format=torch.channels_last)), net(given))


def test_a_batch_equals_its_frames() -> None:
    net, given = decoder(linear=True), features(3, 16, 2, 3)
    for frame in range(3):
        torch.testing.assert_close(net(given[frame : frame + 1])[0], net(given)[frame], rtol=1e-4, atol=1e-5)


def test_gradients_are_those_of_differences() -> None:
    torch.manual_seed(0)
    block = DecoderBlock(2).double()
    given = torch.randn(1, 2, 2, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(block, (given,))
