"""Models in the conventions of the Hugging Face hub: a folder with config.json, model.safetensors and a model card."""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path
from typing import Any, Literal

import torch

from imgtransfer.config.loader import load_config
from imgtransfer.network import TransferModel
from imgtransfer.report.logs import read_entries
from imgtransfer.shipped.models import shipped_model
from imgtransfer.training.checkpoint import MODEL_FILE, MODEL_FORMAT, load_model, read_tensors
from imgtransfer.training.config import RunConfig
from imgtransfer.training.hub_card import model_card
from imgtransfer.training.kept import BEST_FILE
from imgtransfer.training.log import LOG_FILE
from imgtransfer.training.run_folder import CONFIG_FILE
from render import InputError
from render.errors import said_by
from render.files.atomic import written_whole_folder

_log = logging.getLogger(__name__)

HUB_CONFIG_FILE, CARD_FILE = "config.json", "README.md"
_FILES = (HUB_CONFIG_FILE, MODEL_FILE)


def save_pretrained(
    run: str | Path,
    folder: str | Path,
    *,
    licence: str,
    which: Literal["last", "best"] = "last",
    data: str | None = None,
) -> Path:
    """Write the model of a training run as a folder that can be uploaded to the hub.

    `from_pretrained` and `imgtransfer predict` read it. The model card says what it was trained on, for how long, and
    what the last validation measured; look through it before you publish it.

    Args:
        run: the folder of the run.
        folder: appears whole or not at all, in place of an earlier one.
        licence: of the weights, as the hub names licences: "cc0-1.0", "apache-2.0", "other".
        which: the model of the last step, or of the best validation.
        data: what the card says of the training clips; the name of their source if None.

    Returns:
        The folder.

    Raises:
        InputError: no run, or one that has not saved the model.
    """
    run, folder = Path(run), Path(folder)
    source = run / (MODEL_FILE if which == "last" else BEST_FILE)
    model = load_model(source)
    _, header = read_tensors(source, MODEL_FORMAT)
    config = load_config(RunConfig, run / CONFIG_FILE)
    entries, _ = read_entries(run / LOG_FILE)
    card = model_card(
        folder.resolve().name,
        model,
        config,
        [entry for entry in entries if entry["step"] <= header["steps"]],
        licence=licence,
        data=data or ", ".join(Path(source).name for source in config.data.sources),
    )
    with written_whole_folder(folder) as temporary:
        shutil.copyfile(source, temporary / MODEL_FILE)
        (temporary / HUB_CONFIG_FILE).write_text(json.dumps(_hub_config(header), indent=2) + "\n")
        (temporary / CARD_FILE).write_text(card, encoding="utf-8")
    return folder


def from_pretrained(name: str | Path, *, device: str | torch.device = "cpu") -> TransferModel:
    """A model for prediction, by the name of its repository on the hub or by its path.

    Args:
        name: "owner/name"; a folder with `model.safetensors` in it, or that file; or "general", which comes with the
            package.
        device: where the networks shall be.

    Raises:
        InputError: there is none, or the hub cannot be reached and it was not fetched before; or not a model.
    """
    return load_model(model_path(name), device=device)


def model_path(name: str | Path) -> Path:
    """Where the model is on this machine: the path itself, one that comes with the package ("general"), or the folder
    that the hub's client has put it in.

    A file or folder of that name comes first. Only what looks like "owner/name" is asked for at the hub, and only where
    there is no folder "owner".

    Raises:
        InputError: the hub has no such model, or cannot be reached.
    """
    path = Path(name)
    owner = path.parent
    if not path.exists() and (shipped := shipped_model(str(name))) is not None:
        return shipped
    if (
        path.exists()
        or path.is_absolute()
        or len(path.parts) != 2
        or path.suffix == ".safetensors"
        or owner.exists()
    ):
        return path
    from huggingface_hub import snapshot_download  # noqa: PLC0415 (only names of the hub need it)

    repository = path.as_posix()
    error: Exception | None = None
    for cached in (True, False):
        if not cached:
            _log.info("fetching %s from the Hugging Face hub", repository)
        try:
            folder = Path(snapshot_download(repository, allow_patterns=list(_FILES), local_files_only=cached))
        except Exception as raised:  # of the hub's client, of HTTP or of the system
            error = raised
        else:
            if (folder / MODEL_FILE).exists():
                return folder
    reason = said_by(error) if error is not None else f"it has no {MODEL_FILE}"
    raise InputError(
        f"{repository}: no such file or folder, and the Hugging Face hub gives no model of that name ({reason}); "
        f"give a run's folder, or run `hf download {repository}` where there is a network"
    ) from error


def _hub_config(header: dict[str, Any]) -> dict[str, Any]:
    """What others read without opening the weights; the weights' own header is what counts here."""
    return {"model_type": "imgtransfer", "architectures": ["TransferModel"], **header}
