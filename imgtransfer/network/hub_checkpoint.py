"""Checkpoints of pretrained encoders in the hub's format: config.json and model.safetensors, by name or in a folder.

Read by the package `transformers`. Only safetensors files are read, and no program of a checkpoint is run.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from torch import nn

from imgtransfer.network.encoder_config import MAX_DEPTH, MAX_DIM
from render import InputError
from render.errors import said_by
from render.extras import optional

_log = logging.getLogger(__name__)

CONFIG_FILE = "config.json"
# By the `model_type` of config.json. DINO's own checkpoints are plain vision transformers.
_MODELS = {
    "vit": "ViTModel",
    "dinov2": "Dinov2Model",
    "dinov2_with_registers": "Dinov2WithRegistersModel",
    "dinov3_vit": "DINOv3ViTModel",
    "resnet": "ResNetModel",
}
# What checkpoints have and an encoder of patches does not need.
_UNUSED = ("pooler.", "classifier.", "embeddings.mask_token")
_NOT_KEPT = frozenset({"id2label", "label2id", "architectures", "_name_or_path"})
# Greatest sizes, so that a damaged or hostile file cannot ask for networks of any size.
_MOST = {
    "hidden_size": MAX_DIM,
    "num_hidden_layers": MAX_DEPTH,
    "num_attention_heads": MAX_DIM,
    "intermediate_size": 8 * MAX_DIM,
    "mlp_ratio": 16,
    "num_register_tokens": 256,
    "num_channels": 3,
    "patch_size": 64,
    "image_size": 2**14,
    "embedding_size": MAX_DIM,
    "hidden_sizes": MAX_DIM,
    "depths": MAX_DEPTH,
}


def checkpoint_folder(name: str) -> Path:
    """The folder of a checkpoint: `name` itself, or that of the hub's cache, where it is put if it is not there yet.

    Raises:
        InputError: no folder, and no name of the hub, or not cached and the hub does not give it; or no safetensors
            file in it.
    """
    if Path(name).is_dir():
        _check_files(Path(name))
        return Path(name)
    hub = optional("huggingface_hub", "encoders", f"network.encoder.name {name}")
    try:
        hub.utils.validate_repo_id(name)
    except hub.errors.HFValidationError:
        raise InputError(
            f"network.encoder.name: there is no folder {name}, and the hub has no such names either; give a folder "
            f"with a checkpoint's {CONFIG_FILE} and model.safetensors, or a name such as facebook/dino-vitb16"
        ) from None
    files = [CONFIG_FILE, "*.safetensors", "*.safetensors.index.json"]
    error: Exception | None = None
    for offline in (True, False):
        if not offline:
            _log.info("fetching %s from the Hugging Face hub", name)
        try:
            folder = Path(hub.snapshot_download(name, allow_patterns=files, local_files_only=offline))
        except Exception as raised:  # of the hub's client, of HTTP or of the system
            error = raised
        else:
            if not offline or (any(folder.glob("*.safetensors")) and (folder / CONFIG_FILE).exists()):
                _check_files(folder)
                return folder
    assert error is not None
    raise InputError(
        f"network.encoder.name: {name} is no folder and has not been fetched before, and the Hugging Face hub does not "
        f"give it ({said_by(error)}); run `hf download {name}` where there is a network, or give a folder with its "
        f"{CONFIG_FILE} and model.safetensors"
    ) from error


def hub_config(values: Any, source: object) -> Any:
    """The configuration, as `transformers` has it, of an architecture that `kept_values` or a config.json holds.

    Args:
        values: the mapping. source: what messages call it.

    Raises:
        InputError: of no family that is known here, or of no reasonable size.
    """
    kind = values.get("model_type") if isinstance(values, dict) else None
    if not isinstance(kind, str) or kind not in _MODELS:
        raise InputError(
            f"{source}: an encoder with model_type {', '.join(_MODELS)} is wanted, found {kind!r}; choose one of the "
            "DINO families or a ResNet"
        )
    for key, most in _MOST.items():
        sizes = values.get(key, 1)
        for size in sizes if isinstance(sizes, list) else [sizes]:
            least = 0 if key == "num_register_tokens" else 1
            # Some have no value where it follows from others.
            if size is not None and not (isinstance(size, int | float) and least <= size <= most):
                raise InputError(f"{source}: {key} must be from {least} to {most}, found {size!r}")
    try:
        return _model_class(kind).config_class.from_dict(values)
    except Exception as error:  # of its own checks
        raise InputError(f"{source}: not the configuration of an encoder ({said_by(error)})") from error


def read_config(folder: Path) -> Any:
    """`hub_config` of the folder's config.json.

    Raises:
        InputError: it cannot be read, or is of no encoder that is known here.
    """
    path = folder / CONFIG_FILE
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: not readable ({said_by(error)})") from error
    return hub_config(values, path)


def kept_values(config: Any) -> dict[str, Any]:
    """The architecture as a model file keeps it, all defaults written out."""
    values = json.loads(config.to_json_string(use_diff=False))
    return {key: value for key, value in values.items() if key not in _NOT_KEPT}


def pretrained_model(folder: Path, config: Any) -> nn.Module:
    """The model of `transformers` with a folder's weights, each and no other.

    Raises:
        InputError: weights that are missing, left over, of another shape or not finite, or no safetensors file.
    """
    with _quiet():
        try:
            model, report = _model_class(config.model_type).from_pretrained(
                folder,
                config=config,
                use_safetensors=True,
                local_files_only=True,
                ignore_mismatched_sizes=True,  # they are refused below, with their names
                output_loading_info=True,
                dtype=torch.float32,
                **_options(config),
            )
        except Exception as error:  # of safetensors, of the system or of its own checks
            raise InputError(f"{folder}: its weights cannot be read ({said_by(error)})") from error
    left_over = [key for key in report["unexpected_keys"] if not key.startswith(_UNUSED)]
    other_shape = [key if isinstance(key, str) else key[0] for key in report["mismatched_keys"]]
    for fault, keys in (
        ("lacks", report["missing_keys"]),
        ("has, beside what the encoder has,", left_over),
        ("has in another shape", other_shape),
    ):
        if keys:
            more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            raise InputError(
                f"{folder}: its {CONFIG_FILE} is of another model than its weights, which {fault.split()[0]} "
                f"{' '.join(fault.split()[1:])} {min(keys)}{more}; fetch the checkpoint anew".replace(
                    "  ", " "
                )
            )
    if not all(bool(weight.isfinite().all()) for weight in model.parameters()):
        raise InputError(f"{folder}: has weights that are not finite; fetch the checkpoint anew")
    made: nn.Module = model
    return made


def empty_model(config: Any) -> nn.Module:
    """The model of `transformers` with this configuration, to be given its weights."""
    made: nn.Module = _model_class(config.model_type)(config, **_options(config))
    return made


def _options(config: Any) -> dict[str, bool]:
    return {"add_pooling_layer": False} if config.model_type == "vit" else {}


def _model_class(kind: str) -> Any:
    transformers = optional("transformers", "encoders", "a pretrained encoder (network.encoder.kind: hub)")
    if int(transformers.__version__.partition(".")[0]) < 5:  # modules had other names
        raise InputError(
            f"a pretrained encoder needs transformers 5, found {transformers.__version__}: "
            "pip install 'imgtransfer[encoders]'"
        )
    return getattr(transformers, _MODELS[kind])


def _check_files(folder: Path) -> None:
    if not (folder / CONFIG_FILE).exists():
        raise InputError(
            f"{folder}: no {CONFIG_FILE}; a folder with {CONFIG_FILE} and model.safetensors is wanted"
        )
    if not any(folder.glob("*.safetensors")):
        raise InputError(
            f"{folder}: no model.safetensors; weights in any other form are not read, because those may run programs; "
            "choose a checkpoint that has it, or convert it where you trust it"
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Within, `transformers` shows neither bars nor reports of keys."""
    from transformers.utils import logging as its  # noqa: PLC0415  (of an extra)

    level, bars = its.get_verbosity(), its.is_progress_bar_enabled()
    its.set_verbosity(logging.CRITICAL)
    its.disable_progress_bar()
    try:
        yield
    finally:
        its.set_verbosity(level)
        if bars:
            its.enable_progress_bar()
