"""One refinement block: equations 9 to 11 written out, and what may influence what."""

from __future__ import annotations

import torch

from imgtransfer.network.refinement import RefinementBlock


def block() -> RefinementBlock:
    """With norms that do something."""
    torch.manual_seed(0)
    made = RefinementBlock(8, 2).double()
    for norm in (made.norm_cross, made.norm_self, made.norm_mlp):
        torch.nn.init.normal_(norm.weight)
        torch.nn.init.normal_(norm.bias)
    return made


def tokens(count: int, seed: int) -> torch.Tensor:
    return torch.randn(2, count, 8, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def normed(x: torch.Tensor, layer: torch.nn.LayerNorm) -> torch.Tensor:
    """Layer norm by hand."""
    mean, variance = x.mean(dim=-1, keepdim=True), x.var(dim=-1, unbiased=False, keepdim=True)
    return (x - mean) / torch.sqrt(variance + layer.eps) * layer.weight + layer.bias


def test_it_is_what_the_equations_say() -> None:
    made, garment, body = block(), tokens(3, 1), tokens(5, 2)
    crossed = garment + made.cross(normed(garment, made.norm_cross), body)  # 9
    attended = normed(crossed, made.norm_self)
    mixed = crossed + made.self_attention(attended, attended)  # 10
    wanted = mixed + made.mlp(normed(mixed, made.norm_mlp))  # 11
    torch.testing.assert_close(made(garment, body), wanted)


def test_bodies_tokens_have_no_order_and_garments_keep_theirs() -> None:
    made, garment, body = block(), tokens(3, 1), tokens(5, 2)
    torch.testing.assert_close(made(garment, body.flip(1)), made(garment, body))
    torch.testing.assert_close(made(garment.flip(1), body), made(garment, body).flip(1))


def test_frames_do_not_leak_into_each_other() -> None:
    made, garment, body = block(), tokens(3, 1), tokens(5, 2)
    changed = body.clone()
    changed[1] += 1
    assert torch.equal(made(garment, changed)[0], made(garment, body)[0])
    assert not torch.allclose(made(garment, changed)[1], made(garment, body)[1])


def test_without_outputs_the_garments_tokens_pass_unchanged() -> None:
    made, garment = block(), tokens(3, 1)
    for layer in (made.cross.output, made.self_attention.output, made.mlp[2]):
        for parameter in layer.parameters():
            torch.nn.init.zeros_(parameter)
    assert torch.equal(made(garment, tokens(5, 2)), garment)


def test_every_weight_gets_a_gradient_but_for_key_biases() -> None:
    made = block()
    made(tokens(3, 1), tokens(5, 2)).square().sum().backward()
    for name, parameter in made.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().max() > 1e-12, name
    # A shift of all keys shifts all of a query's scores alike, which the softmax does not see.
    assert made.cross.key_value.bias.grad is not None
    assert made.cross.key_value.bias.grad[:8].abs().max() < 1e-12
