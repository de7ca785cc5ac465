"""Which weights decay, how much, and dropout."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import nn

from imgtransfer.config.loader import parse_config
from imgtransfer.network.attention import Attention, mlp
from imgtransfer.training.config import RunConfig, TrainingConfig
from imgtransfer.training.optimizer import build_optimizer, decaying, learning_rate
from imgtransfer.training.trainer import Trainer
from render import InputError
from tests.helpers.training import SMALL, small_config


def test_matrices_decay_and_nothing_else(config: RunConfig) -> None:
    model = Trainer(config).model
    matrices = {id(weight) for weight in decaying(model)}
    decay = {name for name, parameter in model.named_parameters() if id(parameter) in matrices}
    assert "position_net.encoder.blocks.0.attention.query.weight" in decay
    assert "normal_net.decoder.blocks.0.upsample.weight" in decay
    assert "position_net.encoder.embed.weight" in decay
    for name in ("encoder.position", "encoder.cls", "encoder.norm.weight", "encoder.blocks.0.mlp.0.bias"):
        assert f"position_net.{name}" in dict(model.named_parameters())
        assert f"position_net.{name}" not in decay


def test_decay_shrinks_a_weight_by_e_to_the_minus_the_sum_of_the_rates() -> None:
    """Of weights without a gradient; biases stay. The numbers of the configuration's text."""
    options = TrainingConfig(
        steps=1500,
        learning_rate=2e-3,
        schedule="cosine",
        warmup_steps=100,
        optimizer="adamw",
        weight_decay=0.05,
    )
    layer = nn.Linear(2, 2)
    before, bias = layer.weight.detach().clone(), layer.bias.detach().clone()
    optimizer = build_optimizer(layer, options)
    for step in range(options.steps):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(options, step)
        layer.weight.grad, layer.bias.grad = torch.zeros(2, 2), torch.zeros(2)
        optimizer.step()
    total = sum(learning_rate(options, step) for step in range(options.steps))
    assert total == pytest.approx(1.5, rel=2e-3)
    torch.testing.assert_close(layer.weight, before * math.exp(-0.05 * total), rtol=1e-3, atol=0)
    assert torch.equal(layer.bias, bias)


def test_a_state_goes_back_to_the_parameters_that_it_is_of(source: Path, tmp_path: Path) -> None:
    trainer = Trainer(small_config(source, weight_decay=0.1))
    trainer.train_step()
    trainer.save(tmp_path)
    other = Trainer(trainer.config)
    other.load(tmp_path)
    for mine, its in zip(trainer.model.parameters(), other.model.parameters(), strict=True):
        assert torch.equal(trainer.optimizer.state[mine]["exp_avg"], other.optimizer.state[its]["exp_avg"])


def test_dropout_leaves_features_out_in_training_only() -> None:
    torch.manual_seed(0)
    tokens = torch.randn(4, 5, 8)
    attention, layers = Attention(8, 2, 0.5), mlp(8, 0.5)
    for found in (attention.train()(tokens, tokens), layers.train()(tokens)):
        assert 0.3 < (found == 0).float().mean() < 0.7
    for found in (attention.eval()(tokens, tokens), layers.eval()(tokens)):
        assert (found != 0).all()
    without = Attention(8, 2)
    without.load_state_dict(attention.state_dict())  # it has no weights
    assert torch.equal(without.train()(tokens, tokens), attention.eval()(tokens, tokens))


def test_a_run_without_dropout_draws_no_numbers(config: RunConfig) -> None:
    trainer = Trainer(config)
    before = torch.random.get_rng_state()
    trainer.train_step()
    assert torch.equal(torch.random.get_rng_state(), before)


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("training", "ema", 1.0),
        ("training", "ema", 0),
        ("training", "ema", True),
        ("network", "dropout", 1),
        ("network", "dropout", -0.1),
        ("training", "weight_decay", -1),
    ],
)
def test_values_that_mean_nothing_are_one_line(section: str, key: str, value: object) -> None:
    content = {"data": {"source": "x"}, **SMALL, section: {**SMALL[section], key: value}}  # type: ignore[dict-item]
    with pytest.raises(InputError, match=f"run: {section}.{key}: ") as error:
        parse_config(RunConfig, content, "run")
    assert "\n" not in str(error.value)
