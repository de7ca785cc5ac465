"""Fitted methods on disk: a safetensors file whose header says which method it is of, and with which settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imgtransfer.config.loader import plain_values
from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.registry import NETWORK, deformer_class
from imgtransfer.training.checkpoint import (
    FORMAT_VERSION,
    MODEL_FILE,
    MODEL_FORMAT,
    known_offset,
    read_header,
    read_tensors,
    write_tensors,
)
from render import InputError
from render.errors import said_by

DEFORMER_FORMAT = "imgtransfer-deformer"


@dataclass(frozen=True)
class FitRecord:
    """What a file says of the fit, beside the method.

    Args:
        clips: names of those it was fitted to. data: their fingerprint. seed: of the fit.
    """

    clips: tuple[str, ...] = ()
    data: str = ""
    seed: int = 0


def save_deformer(path: str | Path, deformer: Deformer, record: FitRecord | None = None) -> Path:
    """Write a fitted method whole or not at all.

    Raises:
        InputError: it cannot be written, such as for want of space.
    """
    record = record or FitRecord()
    header: dict[str, Any] = {
        "format": DEFORMER_FORMAT,
        "format_version": FORMAT_VERSION,
        "method": deformer.name,
        "config": plain_values(deformer.config),
        "contact_offset_m": deformer.contact_offset_m,
        "clips": record.clips,
        "data": record.data,
        "seed": record.seed,
    }
    return write_tensors(path, deformer.tensors(), header)


def is_deformer(path: str | Path) -> bool:
    """Whether a model's file, or the one in a run's folder, is of a method other than the network.

    Raises:
        InputError: no such file, or not safetensors.
    """
    return read_header(model_file(path)).get("format") == DEFORMER_FORMAT


def load_deformer(path: str | Path) -> Deformer:
    """Read a fitted method; a network's model, too, as `image_transfer`.

    Args:
        path: a file, or a run's folder with `model.safetensors` in it.

    Raises:
        InputError: no such file, not a method that is known here, or one that does not have what its header states.
    """
    path = model_file(path)
    if read_header(path).get("format") == MODEL_FORMAT:
        network: Any = deformer_class(NETWORK)
        loaded: Deformer = network.of_file(path)
        return loaded
    tensors, header = read_tensors(path, DEFORMER_FORMAT)
    try:
        kind = deformer_class(header.get("method"))
        deformer = kind(kind.Config.model_validate(header.get("config")))
        if not all(bool(value.isfinite().all()) for value in tensors.values()):
            raise ValueError("it has numbers that are not finite")
        deformer.restore(tensors)
        deformer.contact_offset_m = known_offset(header, path)
    # pydantic's ValidationError is a ValueError; what a method makes of tensors that are not its own is its affair
    except (InputError, KeyError, ValueError, TypeError, RuntimeError, IndexError, OverflowError) as error:
        raise InputError(
            f"{path}: not a fitted method that this version can read ({said_by(error)})"
        ) from error
    return deformer


def model_file(path: str | Path) -> Path:
    """The file that a run's folder has, or the path itself."""
    path = Path(path)
    return path / MODEL_FILE if path.is_dir() else path
