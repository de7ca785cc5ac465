"""What a run begins with: its frames, its number type, and a model that is new or trained already."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from pydantic import BaseModel
from torch import Tensor

from imgtransfer.data.choice import NoClip
from imgtransfer.data.clip import Clip
from imgtransfer.data.source import ClipRef, clip_refs
from imgtransfer.network import TransferModel
from imgtransfer.network.memory import check_training_memory
from imgtransfer.network.shapes import same_faces
from imgtransfer.network.shared_trunk import share_trunks
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.checkpoint import load_model
from imgtransfer.training.config import ClipChoice, RunConfig
from imgtransfer.training.precision import Precision, Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.processes import Processes
from imgtransfer.training.sampler import Frames
from render import InputError, Mesh, Option, PositionBox

_log = logging.getLogger(__name__)

_OF_TRAINING_ALONE = frozenset({"dropout"})  # settings of the network that its weights do not hang on


def first_model(config: RunConfig, frames: Frames, device: torch.device) -> TransferModel:
    """The model that a run begins with, on the device where it is trained: a new one, or that of `training.init`.

    Raises:
        InputError: too little memory, or a trained model that does not fit (`trained_model`).
    """
    options = config.training
    if device.type == "cpu":
        check_training_memory(
            config.network,
            config.maps,
            batch_frames=options.batch_frames,
            averaged=options.ema is not None,
        )
    model = new_model(config, frames) if options.init is None else trained_model(config, frames, options.init)
    model = model.to(device)
    share_trunks(model.position_net, model.normal_net)
    return model


def new_model(config: RunConfig, frames: Frames) -> TransferModel:
    """An untrained model of the garment in `frames`; a general one where there are several."""
    first = frames.first
    return TransferModel(
        maps=config.maps,
        network=config.network,
        template=Mesh(first.template.vertices, first.template.faces, first.name),
        box=PositionBox.around(frames.garment_bounds()),
        body=Mesh(first.body.rest, first.body.faces, first.name),
        general=len(frames.outfits) > 1,
    )


def trained_model(config: RunConfig, frames: Frames, path: Path) -> TransferModel:
    """The model at `path`, to be trained further on `frames`.

    It keeps its template, body and position box, so that images mean to it what they did; from a general model only the
    networks are taken, to which every garment is as any other. It has no head yet (`Trainer.fit_head`).

    Raises:
        InputError: no model, or one of another garment, other maps or another network than the run's.
    """
    known = load_model(path)
    if known.general:
        model = new_model(config, frames)
        _check_settings("maps", known.asked, config.maps, path)
        alone = model.network.model_copy(
            update={"head": known.network.head}
        )  # the run's own, fitted to what is left
        _check_settings("network", known.network, alone, path)
        model.load_state_dict(known.state_dict())
        return model
    if len(frames.outfits) > 1:
        raise InputError(
            f"{path}: this model was trained on one garment, and the run has {len(frames.outfits)}; choose clips with "
            f"data.train.names, or leave out {Option('init')} to begin anew"
        )
    _check_garment(known, frames.first, path)
    model = TransferModel(
        maps=config.maps,
        network=config.network,
        template=known.imager.mesh,
        box=known.box,
        body=known.body,
        architecture=known.architecture,
        layouts=known.layouts,
    )
    # Of the models, not of the configurations: theirs have the elevations that were chosen for the template.
    _check_settings("maps", known.maps, model.maps, path)
    _check_settings("network", known.network, model.network, path)
    known.head = None  # the run fits its own
    model.load_state_dict(known.state_dict())
    return model


def _check_garment(known: TransferModel, clip: Clip, path: Path) -> None:
    mesh, template = known.imager.mesh, clip.template
    if not same_faces(mesh.faces, template.faces):
        raise InputError(
            f"{path}: this model's garment ({len(mesh.vertices)} vertices, {len(mesh.faces)} faces) is not that of "
            f"{clip.name} ({len(template.vertices)}, {len(template.faces)}); leave out {Option('init')} to begin anew"
        )
    try:
        known.check_garment(clip)
    except InputError as error:
        raise InputError(f"{path}: no model to begin with for this garment: {error}") from error


def _check_settings(section: str, known: BaseModel, wanted: BaseModel, path: Path) -> None:
    """Raise InputError where two sections differ; it names the first key that does."""
    trained, run = _flat(known, section), _flat(wanted, section)
    for key, value in trained.items():
        if value != run[key]:
            raise InputError(
                f"{path}: this model was trained with {key} {value}, and the run has {run[key]}; set it to the "
                f"model's, or leave out {Option('init')} to begin anew"
            )


def _flat(section: BaseModel, name: str) -> dict[str, Any]:
    """Values by their whole keys, such as network.encoder.dim."""
    flat: dict[str, Any] = {}
    for key in type(section).model_fields:
        value = getattr(section, key)
        if isinstance(value, BaseModel):
            flat |= _flat(value, f"{name}.{key}")
        elif key not in _OF_TRAINING_ALONE:
            flat[f"{name}.{key}"] = list(value) if isinstance(value, tuple) else value
    return flat


def chosen_frames(config: RunConfig, choice: ClipChoice) -> Frames:
    """The frames of the clips that a configuration chooses.

    Raises:
        InputError: a source that cannot be read, or no clip in any of them that matches.
    """
    data = config.data
    return Frames(
        [ref.reader() for ref in _chosen_refs(data.sources, choice)],
        config.maps.root,
        int(data.cache_gb * 1e9),
        several=config.network.body == "local",
        history_s=config.network.history_s,
        skins=config.network.skins,
    )


def _chosen_refs(sources: Sequence[Path], choice: ClipChoice) -> list[ClipRef]:
    """The clips chosen from all sources; some may have none, such as a data set without a validation split."""
    refs: list[ClipRef] = []
    without: list[NoClip] = []
    for source in sources:
        try:
            refs += clip_refs(source, split=choice.split, names=choice.names, exclude=choice.exclude)
        except NoClip as error:
            without.append(error)
    if not refs:
        raise NoClip("; ".join(str(error) for error in without))
    for nothing in without:  # meant so, or a pattern that is mistyped
        _log.info("%s; the clips of the other data sets are taken", nothing)
    return refs


def agreed_precision(config: RunConfig, processes: Processes) -> Precision:
    """The number type, the same in all processes."""
    workload = Workload.of(config.maps, config.network, config.training.batch_frames)

    def ratio() -> float:
        return processes.mean({"ratio": bfloat16_ratio(processes.device, workload)})["ratio"]

    return choose_precision(config.training.precision, ratio)


def preparation_mark(config: RunConfig, frames: Frames, head: Tensor | None) -> str:
    """A text that changes with what prepared frames hang on (`PatchLosses.prepare`); `head` are its weights."""
    texts = [part.model_dump_json() for part in (config.data, config.maps, config.network)]
    weights = [] if head is None else [head.cpu().numpy().tobytes()]
    return fingerprint([*texts, frames.mark, *weights])
