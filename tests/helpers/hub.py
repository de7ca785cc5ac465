"""Tiny checkpoints in the hub's format, of every family of encoders that is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

VITS = ("vit", "dinov2", "dinov2_with_registers", "dinov3_vit")
REGISTERS = 3


def checkpoint(folder: Path, kind: str = "vit", **changes: object) -> Path:
    """Write one, with weights that are not all 0 or 1; of 64 x 64 pixels, tokens of 32 features and 3 blocks."""
    model = random_model(kind, **changes)
    model.save_pretrained(folder)
    return folder


def random_model(kind: str, **changes: object) -> Any:
    import transformers  # noqa: PLC0415  (seconds, which only its tests need wait for)

    torch.manual_seed(0)
    vit: dict[str, object] = {
        "hidden_size": 32,
        "num_hidden_layers": 3,
        "num_attention_heads": 2,
        "image_size": 64,
    }
    small = {
        "vit": vit | {"intermediate_size": 48, "patch_size": 16},
        "dinov2": vit | {"mlp_ratio": 2, "patch_size": 14, "image_size": 56},
        "dinov2_with_registers": vit
        | {"mlp_ratio": 2, "patch_size": 14, "image_size": 56, "num_register_tokens": REGISTERS},
        "dinov3_vit": vit | {"intermediate_size": 48, "patch_size": 16, "num_register_tokens": REGISTERS},
        "resnet": {"embedding_size": 8, "hidden_sizes": [8, 16, 24, 32], "depths": [1, 1, 2, 2]},
    }
    names = {
        "vit": "ViT",
        "dinov2": "Dinov2",
        "dinov2_with_registers": "Dinov2WithRegisters",
        "dinov3_vit": "DINOv3ViT",
        "resnet": "ResNet",
    }
    config = getattr(transformers, f"{names[kind]}Config")(**small[kind] | changes)
    model = getattr(transformers, f"{names[kind]}Model")(config).eval()
    for weight in model.parameters():
        nn.init.normal_(weight, std=0.2)
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_var, 0.5, 2)
            nn.init.normal_(module.running_mean)
    return model
