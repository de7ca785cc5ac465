"""The optimiser of a run: its learning rate, and which weights decay."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from imgtransfer.training.config import TrainingConfig


def build_optimizer(model: nn.Module, options: TrainingConfig) -> torch.optim.Optimizer:
    """Adam or AdamW of all parameters, with weight decay of the matrices only."""
    matrices = {id(matrix) for matrix in decaying(model)}
    groups = [
        {
            "params": [p for p in model.parameters() if id(p) in matrices],
            "weight_decay": options.weight_decay,
        },
        {"params": [p for p in model.parameters() if id(p) not in matrices], "weight_decay": 0.0},
    ]
    kind = torch.optim.Adam if options.optimizer == "adam" else torch.optim.AdamW
    return kind([group for group in groups if group["params"]], lr=options.learning_rate, fused=True)


def decaying(model: nn.Module) -> list[Tensor]:
    """The weights of linear layers and convolutions.

    What weight decay pulls to 0 is how strongly a layer follows its inputs. A bias or an embedding has no input, and
    the scale of a norm has 1 for its neutral value.
    """
    layers = (nn.Linear, nn.Conv2d, nn.ConvTranspose2d)
    return [module.weight for module in model.modules() if isinstance(module, layers)]


def moments(model: nn.Module, optimizer: torch.optim.Optimizer) -> dict[int, dict[str, Tensor]]:
    """What the optimiser keeps of each of the model's parameters, by the parameter's number."""
    return {
        number: dict(optimizer.state[parameter])
        for number, parameter in enumerate(model.parameters())
        if parameter in optimizer.state
    }


def set_moments(
    model: nn.Module, optimizer: torch.optim.Optimizer, state: dict[int, dict[str, Tensor]]
) -> None:
    """Put back what `moments` gave."""
    groups = optimizer.param_groups
    place = {id(parameter): n for n, parameter in enumerate(p for group in groups for p in group["params"])}
    numbered = {place[id(p)]: state[number] for number, p in enumerate(model.parameters()) if number in state}
    optimizer.load_state_dict({"state": numbered, "param_groups": optimizer.state_dict()["param_groups"]})


def learning_rate(options: TrainingConfig, step: int) -> float:
    """The rate of step 0, 1, ...: a linear warm-up, then constant, or a line or half a cosine down to 0 at the end."""
    if step < options.warmup_steps:
        return options.learning_rate * (step + 1) / options.warmup_steps
    if options.schedule == "constant":
        return options.learning_rate
    done = (step - options.warmup_steps) / max(options.steps - options.warmup_steps, 1)
    if options.schedule == "linear":
        return options.learning_rate * (1 - done)
    return options.learning_rate * (1 + math.cos(math.pi * done)) / 2
