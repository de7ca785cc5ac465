"""Patches as tokens: the convolution's numbers, in bfloat16 too."""

import pytest
import torch
from torch.nn import functional

from imgtransfer.network.patch_embedding import PatchEmbedding


def test_two_patches_by_hand() -> None:
    embed = PatchEmbedding(1, 1, 2)
    with torch.no_grad():
        embed.weight.copy_(torch.tensor([[[[1.0, 10.0], [100.0, 1000.0]]]]))
        embed.bias.fill_(0.5)
    image = torch.tensor([[[[1.0, 2.0, 5.0, 6.0], [3.0, 4.0, 7.0, 8.0]]]])
    assert embed(image).tolist() == [[[[4321.5], [8765.5]]]]


@pytest.mark.parametrize(("channels", "patch"), [(3, 8), (10, 16), (16, 4)])
def test_it_is_the_convolution(channels: int, patch: int) -> None:
    torch.manual_seed(0)
    embed, images = PatchEmbedding(channels, 5, patch).double(), torch.randn(2, channels, 32, 64).double()
    wanted = functional.conv2d(images, embed.weight, embed.bias, stride=patch).movedim(1, -1)
    torch.testing.assert_close(embed(images), wanted, rtol=0, atol=1e-12)


def test_gradients_are_those_of_differences() -> None:
    torch.manual_seed(0)
    embed = PatchEmbedding(2, 3, 2).double()
    assert torch.autograd.gradcheck(embed, (torch.randn(1, 2, 4, 6).double().requires_grad_(True),))


@pytest.mark.parametrize(("channels", "patch"), [(3, 16), (8, 8), (10, 16), (16, 14)])
def test_bfloat16_only_rounds(channels: int, patch: int) -> None:
    # As convolutions these are off by as much as they are large on processors with AMX units (PyTorch 2.13).
    torch.manual_seed(0)
    embed, images = PatchEmbedding(channels, 64, patch), torch.randn(2, channels, 112, 112)
    with torch.no_grad():
        wanted = embed(images)
        with torch.autocast("cpu", torch.bfloat16):
            found = embed(images).float()
    assert float((found - wanted).norm() / wanted.norm()) < 0.01
