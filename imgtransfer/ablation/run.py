"""Ablations from start to end: each training once, whichever tables it stands in; then the tables."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from fusion import FusionConfig
from imgtransfer.ablation.config import AblationConfig, AblationRow
from imgtransfer.ablation.fusion_terms import fused_with
from imgtransfer.ablation.table import markdown
from imgtransfer.benchmark.machine import machine
from imgtransfer.benchmark.measure import (
    PREDICTIONS,
    RUN,
    MethodResult,
    MethodTask,
    MethodVariants,
    measure,
    standing_result,
    write_result,
)
from imgtransfer.benchmark.run import data_facts
from imgtransfer.data.source import clip_refs
from imgtransfer.deformers.fit import clips_fingerprint
from imgtransfer.evaluation.metrics import evaluate_clip, mean_over_frames
from imgtransfer.pipeline.folder import MAPS_FILE, folder_of_clip
from imgtransfer.running import Executor, run_tasks
from imgtransfer.running.fingerprint import fingerprint
from imgtransfer.training.checkpoint import fingerprint as model_fingerprint
from render import load_maps
from render.files.atomic import written_whole

RESULTS_FILE, MARKDOWN_FILE, FITS = "results.json", "tables.md", "fits"


@dataclass(frozen=True, kw_only=True)
class TermsTask:
    """A trained model whose predictions are fused with some terms left out.

    Args:
        fit: the task that has trained it, done already. terms: one of `imgtransfer.ablation.fusion_terms.TERMS`.
    """

    fit: MethodTask
    terms: str

    @property
    def name(self) -> str:
        """Of the training and the terms."""
        return f"{self.fit.name}, {self.terms}"


def run_ablations(configs: Mapping[str, AblationConfig], out: Path, *, executor: Executor) -> dict[str, Any]:
    """Train what is not trained yet, measure every row, and write results.json and tables.md.

    Args:
        configs: by name, such as that of their file. Rows of several tables that are one training are trained once.
        out: folder for everything; a run that was stopped goes on there.
        executor: where the trainings, independent tasks, are worked on.

    Returns:
        The content of results.json.

    Raises:
        InputError: a configuration or clips that cannot be used; a training that failed, once the others are done and
            written.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, once what is done is saved.
    """
    for name, config in configs.items():
        config.check(name)
    tasks = {
        (name, row.label, seed): _task(config, row, seed, out)
        for name, config in configs.items()
        for row in config.rows
        for seed in config.seeds
    }
    facts = {name: data_facts(config.data) for name, config in configs.items()}
    trained = run_tasks(
        measure,
        list({task.folder: task for task in tasks.values()}.values()),
        executor=executor,
        name=lambda task: task.name,
        say=MethodResult.line,
        unit="training",
    )
    rows = {(name, row.label): row for name, config in configs.items() for row in config.rows}
    wanted = [
        TermsTask(fit=task, terms=terms)
        for (name, label, _), task in tasks.items()
        if (terms := rows[name, label].terms) not in (None, "full") and task.name in trained.values
    ]
    fused = run_tasks(
        measure_terms,
        wanted,
        executor=executor,
        name=lambda task: task.name,
        say=MethodResult.line,
        unit="fusion",
    )
    done = trained.values | fused.values

    def result_of(name: str, label: str, seed: int) -> MethodResult | None:
        task, terms = tasks[name, label, seed], rows[name, label].terms
        return done.get(task.name if terms in (None, "full") else TermsTask(fit=task, terms=terms).name)

    results: dict[str, Any] = {"machine": machine(), "tables": {}}
    for name, config in configs.items():
        found = {
            row.label: {
                seed: asdict(one) for seed in config.seeds if (one := result_of(name, row.label, seed))
            }
            for row in config.rows
        }
        results["tables"][name] = {
            "config": config.model_dump(mode="json"), "data": facts[name], "rows": found,
        }  # fmt: skip
    _write(out, results)
    trained.check("training")
    fused.check("fusion")
    return results


def measure_terms(task: TermsTask) -> MethodResult:
    """Fuse the predictions of a training with the terms, and measure; a result that stands already is only read."""
    torch.set_num_threads(task.fit.threads)
    choice, folder = task.fit.data.test, task.fit.folder
    refs = clip_refs(task.fit.data.source, split=choice.split, names=choice.names, exclude=choice.exclude)
    clips = [ref.load() for ref in refs]
    parts = [model_fingerprint(folder / RUN), clips_fingerprint(clips), task.terms]
    made = fingerprint([*parts, json.dumps(task.fit.evaluate.model_dump())])
    file = folder / f"terms_{_slug(task.terms)}.json"
    if (standing := standing_result(file, made)) is not None:
        return standing
    of_clips: MethodVariants = {"fused": {}}
    for clip in clips:
        assert clip.garment is not None  # as `measure` has checked
        maps = load_maps(folder / PREDICTIONS / folder_of_clip(clip.name) / MAPS_FILE)
        vertices = fused_with(maps, clip, task.terms, FusionConfig())
        of_clips["fused"][clip.name] = evaluate_clip(
            vertices,
            clip.garment.vertices,
            clip.template.faces,
            clip.body.vertices,
            clip.body.faces,
            config=task.fit.evaluate,
        )
    frames = {clip.name: clip.n_frames for clip in clips}
    overall = mean_over_frames((values, frames[name]) for name, values in of_clips["fused"].items())
    label = f"{task.fit.label}, {task.terms}"
    result = MethodResult(
        data=task.fit.data.name, label=label, variants=of_clips, overall={"fused": overall}, frames=frames
    )
    write_result(file, made, result)
    return result


def _task(config: AblationConfig, row: AblationRow, seed: int, out: Path) -> MethodTask:
    """The training of a row; rows that differ in nothing else get the same folder, and so are one task."""
    content = config.content_of(row, seed)
    mark = fingerprint([json.dumps(content, sort_keys=True), json.dumps(config.data.model_dump(mode="json"))])
    kind = _slug(str(config.settings_of(row).get("name")))
    return MethodTask(
        label=f"{kind}-{mark[:8]}, seed {seed}",
        data=config.data,
        content=content,
        folder=out / FITS / f"{kind}-{mark[:8]}-s{seed}",
        evaluate=config.evaluate,
        threads=config.threads,
    )


def _write(out: Path, results: Mapping[str, Any]) -> None:
    out.mkdir(parents=True, exist_ok=True)
    texts: Sequence[tuple[str, str]] = (
        (RESULTS_FILE, json.dumps(results, indent=1)),
        (MARKDOWN_FILE, markdown(results)),
    )
    for name, text in texts:
        with written_whole(out / name) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")
