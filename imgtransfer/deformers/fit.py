"""A method's fit from start to end in a run's folder, stopped and gone on with."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imgtransfer.config.loader import load_config, plain_values, to_yaml
from imgtransfer.data.clip import Clip
from imgtransfer.data.contact_offset import of_clips
from imgtransfer.data.source import clip_refs
from imgtransfer.deformers.base import FitFolder
from imgtransfer.deformers.checkpoint import FitRecord, is_deformer, load_deformer, save_deformer
from imgtransfer.deformers.config import MethodRunConfig, make_deformer
from imgtransfer.deformers.image_transfer.method import ImageTransfer
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.checkpoint import MODEL_FILE
from imgtransfer.training.config import DataConfig
from imgtransfer.training.loop import train
from imgtransfer.training.run_folder import CONFIG_FILE, LOCK_FILE, only_trainer
from render import InputError, Option
from render.files.atomic import written_whole
from render.threads import one_blas_thread

_log = logging.getLogger(__name__)

DATA_FILE = "data.json"  # the fingerprint of the clips that a run was begun with


@one_blas_thread()
def fit_run(config: MethodRunConfig, out: Path, *, resume: bool = False) -> Path:
    """Fit a method and write config.yaml and model.safetensors, beside what the method itself keeps in the folder.

    A run of `image_transfer` is the network's training (`imgtransfer.training.train`), in all it writes.

    Args:
        config: the run.
        out: its folder. Only one process may fit there at a time.
        resume: go on with the run in `out`.

    Returns:
        The model's file.

    Raises:
        InputError: clips or settings that the method cannot take; a run in `out` already, or none to resume, or one of
            another configuration or other clips; another process that works there.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, once what is done is saved.
    """
    deformer = make_deformer(config)
    if isinstance(deformer, ImageTransfer):
        assert isinstance(config.data, DataConfig)
        network = deformer.run_config(config.data, seed=config.seed, threads=config.threads)
        return train(network, out, resume=resume)
    if resume and not out.is_dir():
        raise InputError(f"{out}: no run to resume there; leave out {Option('resume')} to start one")
    with only_trainer(out):
        _check_folder(out, config, resume=resume)
        model = out / MODEL_FILE
        if model.exists():
            load_deformer(model)  # it may be damaged
            _log.info("%s: fitted already", out)
            return model
        if config.threads:
            torch.set_num_threads(config.threads)
        choice = config.data.train
        refs = clip_refs(config.data.source, split=choice.split, names=choice.names, exclude=choice.exclude)
        clips = [ref.load() for ref in refs]
        mark = clips_fingerprint(clips)
        _check_data(out, mark)
        with written_whole(out / CONFIG_FILE) as temporary:
            temporary.write_text(to_yaml(config))
        torch.manual_seed(config.seed)
        deformer.fit(clips, FitFolder(out, config.seed, config.threads))
        deformer.contact_offset_m = of_clips(clips)
        record = FitRecord(tuple(clip.name for clip in clips), mark, config.seed)
        return save_deformer(model, deformer, record)


def clips_fingerprint(clips: Iterable[Clip]) -> str:
    """A text that changes with the clips' arrays, rates or order; their names count for nothing."""

    def parts() -> Iterator[str | memoryview]:
        for clip in clips:
            yield repr(clip.fps)
            for key, array in sorted(clip.arrays().items()):
                yield f"{key} {array.dtype.str} {array.shape}"
                yield np.ascontiguousarray(array).data

    return fingerprint(parts())


def _check_folder(out: Path, config: MethodRunConfig, *, resume: bool) -> None:
    """Raise InputError where a run cannot begin or go on in `out`."""
    path, saved = out / CONFIG_FILE, any(out.glob("*.safetensors"))
    if saved and not resume:
        raise InputError(
            f"{out}: holds a run already; add {Option('resume', True)} to go on with it, or choose another "
            f"{Option('out')}"
        )
    if not saved:  # it begins, or begins anew after it was stopped early
        if resume and not path.exists() and any(entry.name != LOCK_FILE for entry in out.iterdir()):
            raise InputError(
                f"{out}: no run to resume there (no {CONFIG_FILE}); leave out {Option('resume')} to start one"
            )
        (out / DATA_FILE).unlink(missing_ok=True)
        return
    if not path.exists():
        raise InputError(
            f"{out}: cannot resume, {CONFIG_FILE} is missing; choose another {Option('out')} for a new run"
        )
    if (out / MODEL_FILE).exists() and not is_deformer(out):
        raise InputError(
            f"{out}: cannot resume, the run there is a network's; choose another {Option('out')}"
        )
    before, now = _flat(plain_values(load_config(type(config), path))), _flat(plain_values(config))
    changed = [key for key in {**before, **now} if before.get(key) != now.get(key) and key != "threads"]
    if changed:
        key = changed[0]
        raise InputError(
            f"{out}: cannot resume, {key} is {now.get(key)} now and was {before.get(key)}; set it back, or start a new "
            f"run with another {Option('out')}"
        )


def _check_data(out: Path, mark: str) -> None:
    """Write down what the run is fitted to; raise InputError where it was begun with other clips."""
    path = out / DATA_FILE
    if path.exists():
        try:
            before = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            before = None
        if before != {"fingerprint": mark}:
            raise InputError(
                f"{out}: the training data have changed since; start a new run with another {Option('out')}"
            )
        return
    with written_whole(path) as temporary:
        temporary.write_text(json.dumps({"fingerprint": mark}), encoding="utf-8")


def _flat(values: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Values by their whole keys, such as method.neighbours."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        flat |= _flat(value, f"{above}{key}.") if isinstance(value, dict) else {f"{above}{key}": value}
    return flat
