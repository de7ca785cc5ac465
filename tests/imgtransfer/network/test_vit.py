"""The image encoder: patches in their order, influence everywhere, sizes that fit."""

from __future__ import annotations

import pytest
import torch

from imgtransfer.network.config import EncoderConfig
from imgtransfer.network.encoders import build_encoder
from imgtransfer.network.vit import VitBlock, VitEncoder
from render import InputError

SIZE, PATCH, DIM = (8, 12), 4, 8  # 2 rows of 3 patches


def encoder(depth: int = 2) -> VitEncoder:
    torch.manual_seed(0)
    return VitEncoder(size=SIZE, patch=PATCH, dim=DIM, depth=depth, heads=2).double()


def images(batch: int = 2) -> torch.Tensor:
    return torch.rand(batch, 3, *SIZE, generator=torch.Generator().manual_seed(1), dtype=torch.float64)


def test_without_blocks_every_token_is_its_own_patch_row_by_row() -> None:
    made, given = encoder(depth=0), images()
    tokens = made(given)
    assert tokens.shape == (2, 7, DIM)
    for row in range(2):
        for column in range(3):
            patch = given[:, :, 4 * row : 4 * row + 4, 4 * column : 4 * column + 4]
            linear = torch.einsum("oihw,bihw->bo", made.embed.weight, (patch - 0.5) / 0.25) + made.embed.bias
            place = 3 * row + column
            wanted = made.norm(linear + made.position[0, place])
            torch.testing.assert_close(tokens[:, 1 + place], wanted)
    torch.testing.assert_close(tokens[:, 0], made.norm(made.cls[0]).expand(2, DIM))


def test_with_blocks_every_patch_reaches_every_token() -> None:
    made, given = encoder(depth=1), images(1)
    before = made(given)
    changed = given.clone()
    changed[..., :4, 8:] += 0.1
    assert ((made(changed) - before).abs().amax(dim=-1) > 1e-9).all()


def test_a_block_with_silent_layers_changes_nothing_and_has_no_order() -> None:
    torch.manual_seed(0)
    block = VitBlock(DIM, 2).double()
    tokens = torch.randn(1, 5, DIM, dtype=torch.float64)
    torch.testing.assert_close(block(tokens.flip(1)), block(tokens).flip(1))
    for layer in (block.attention.output, block.mlp[2]):
        for parameter in layer.parameters():
            torch.nn.init.zeros_(parameter)
    assert torch.equal(block(tokens), tokens)


def test_a_batch_equals_its_images() -> None:
    made, given = encoder(), images(3)
    for number in range(3):
        torch.testing.assert_close(made(given[number : number + 1])[0], made(given)[number])


@pytest.mark.parametrize("size", [(8, 13), (9, 12)])
def test_sizes_that_leave_a_part_of_a_patch_are_refused(size: tuple[int, int]) -> None:
    wanted = rf"maps.size is {size[0]}x{size[1]} \(height x width\), not a multiple of the 4-pixel patch"
    with pytest.raises(InputError, match=wanted):
        VitEncoder(size=size, patch=PATCH, dim=DIM, depth=1, heads=2)


def test_images_with_height_and_width_swapped_are_refused() -> None:
    with pytest.raises(InputError, match=r"images are 12x8 .*, but the encoder was made for 8x12"):
        encoder()(images().mT)


def test_a_configuration_builds_what_it_says() -> None:
    made = build_encoder(EncoderConfig(patch=4, dim=16, depth=3, heads=4), SIZE)
    assert (made.size, made.grid, len(made.blocks)) == (SIZE, (2, 3), 3)
    assert made(images(1).float()).shape == (1, 7, 16)
    assert made.blocks[0].attention.heads == 4
