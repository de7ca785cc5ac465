"""Attention, MLP and position embedding: gradients and laws."""

from __future__ import annotations

import torch
from torch.nn import functional

from imgtransfer.network.attention import Attention, mlp, sine_cosine_grid


def layer(dim: int = 8, heads: int = 2) -> Attention:
    torch.manual_seed(0)
    return Attention(dim, heads).double()


def tokens(*shape: int, seed: int = 1) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_it_equals_pytorchs_own_attention() -> None:
    attend, queries, context = layer(), tokens(2, 3, 8), tokens(2, 5, 8, seed=2)
    key, value = attend.key_value(context).chunk(2, dim=-1)

    def split(x: torch.Tensor) -> torch.Tensor:
        return x.unflatten(-1, (2, 4)).transpose(1, 2)

    wanted = functional.scaled_dot_product_attention(split(attend.query(queries)), split(key), split(value))
    torch.testing.assert_close(attend(queries, context), attend.output(wanted.transpose(1, 2).flatten(2)))


def test_the_order_of_the_context_does_not_matter_and_that_of_the_queries_is_kept() -> None:
    attend, queries, context = layer(), tokens(1, 3, 8), tokens(1, 5, 8, seed=2)
    whole = attend(queries, context)
    torch.testing.assert_close(attend(queries, context[:, [3, 0, 4, 2, 1]]), whole)
    torch.testing.assert_close(attend(queries[:, [2, 0, 1]], context), whole[:, [2, 0, 1]])


def test_equal_context_tokens_count_as_one_and_a_single_one_is_all_there_is() -> None:
    attend, queries, context = layer(), tokens(1, 3, 8), tokens(1, 1, 8, seed=2)
    one = attend(queries, context)
    torch.testing.assert_close(attend(queries, context.expand(1, 4, 8)), one)
    value = attend.key_value(context).chunk(2, dim=-1)[1]
    torch.testing.assert_close(one, attend.output(value).expand(1, 3, 8))  # whatever is asked


def test_a_key_that_fits_much_better_takes_everything_and_nothing_overflows() -> None:
    attend, queries, context = layer(), tokens(1, 3, 8), 1e4 * tokens(1, 5, 8, seed=2)
    result = attend(queries, context)
    value = attend.key_value(context).chunk(2, dim=-1)[1]
    assert torch.isfinite(result).all()
    best = [torch.linalg.vector_norm(result[0, n] - attend.output(torch.cat([a[:4], b[4:]]))) for n in range(3)
            for a in value[0] for b in value[0]]  # fmt: skip
    assert torch.stack(best).reshape(3, -1).min(dim=1).values.max() < 1e-3  # one value a head


def test_gradients_are_those_of_differences() -> None:
    attend = layer(4, 2)
    inputs = (tokens(1, 2, 4).requires_grad_(True), tokens(1, 3, 4, seed=2).requires_grad_(True))
    assert torch.autograd.gradcheck(attend, inputs)


def test_the_mlp_widens_fourfold_and_treats_each_token_alone() -> None:
    torch.manual_seed(0)
    widen = mlp(8).double()
    assert [tuple(p.shape) for p in widen.parameters()] == [(32, 8), (32,), (8, 32), (8,)]
    several = tokens(2, 3, 8)
    torch.testing.assert_close(widen(several)[1, 2], widen(several[1, 2]))


def test_positions_are_told_apart_and_depend_on_row_and_column_alone() -> None:
    embedding = sine_cosine_grid((6, 5), 16)
    assert embedding.shape == (30, 16)
    torch.testing.assert_close(embedding.square().sum(dim=1), torch.full((30,), 8.0))  # sin² + cos², 8 times
    apart = torch.cdist(embedding, embedding) + 10 * torch.eye(30)
    assert apart.min() > 0.4
    # A step to the next row changes the row's half by the same turn everywhere: distances depend on steps alone.
    grid = embedding.unflatten(0, (6, 5))
    steps = (grid[1:] - grid[:-1]).square().sum(dim=-1)
    torch.testing.assert_close(steps, steps[:1, :1].expand(5, 5))


def test_frequencies_go_from_one_radian_a_patch_to_a_hundredth() -> None:
    grid = sine_cosine_grid((2, 1), 12)[1]  # one row down: three sines, three cosines, of the row
    frequencies = torch.tensor([1.0, 0.1, 0.01])
    torch.testing.assert_close(grid[:6], torch.cat([frequencies.sin(), frequencies.cos()]))
    assert torch.equal(grid[6:], torch.tensor([0.0, 0, 0, 1, 1, 1]))  # the column is 0
