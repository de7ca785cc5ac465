"""A benchmark from start to end: tasks, results, tables, pictures, page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from imgtransfer.benchmark.config import BenchmarkConfig, BenchmarkData, label_of, parsed, run_content
from imgtransfer.benchmark.machine import machine
from imgtransfer.benchmark.measure import MethodResult, MethodTask, measure, predicted_files
from imgtransfer.benchmark.mode_tables import mode_tables
from imgtransfer.benchmark.modes import check_modes, run_modes
from imgtransfer.benchmark.page import write_benchmark_page
from imgtransfer.benchmark.pictures import Candidate, ClipPictures, clip_pictures
from imgtransfer.benchmark.statistics import bootstrap_intervals
from imgtransfer.benchmark.tables import clips_table, overall_table, row_name
from imgtransfer.data.source import ClipRef, clip_refs
from imgtransfer.deformers.fit import clips_fingerprint
from imgtransfer.deformers.registry import NETWORK
from imgtransfer.pipeline.folder import folder_of_clip
from imgtransfer.running import Executor, run_tasks
from imgtransfer.training.config import ClipChoice
from render import InputError, Option, write_png
from render.files.atomic import written_whole

RESULTS_FILE, MARKDOWN_FILE, LATEX_FILE, PAGE_FILE = "results.json", "tables.md", "tables.tex", "report.html"


def run_benchmark(
    config: BenchmarkConfig,
    out: Path,
    *,
    executor: Executor,
    source: str,
    only: Sequence[str] | None = None,
    predictions: Mapping[str, Path] | None = None,
) -> dict[str, Any]:
    """Fit what is not fitted yet, measure every method, and write results.json, tables, pictures and the page.

    Args:
        config: of the benchmark.
        out: folder for everything; a run that was stopped goes on there.
        executor: where the methods, each an independent task, are worked on.
        source: what an InputError calls the configuration.
        only: labels of the methods to take; None takes all.
        predictions: by label, folders with clips that other programs have predicted.

    Returns:
        The content of results.json.

    Raises:
        InputError: a configuration, clips or predictions that cannot be used; a method that failed, once the others
            are done and written.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, once what is done is saved.
    """
    tasks = benchmark_tasks(config, out, source=source, only=only, predictions=predictions or {})
    data = {one.name: data_facts(one) for one in config.data}
    done = run_tasks(
        measure, tasks, executor=executor, name=lambda task: task.name, say=MethodResult.line, unit="method"
    )
    finished = [task for task in tasks if task.name in done.values]
    modes = run_modes(config, finished, done.values, executor=executor)
    results = {
        "config": config.model_dump(mode="json"),
        "machine": machine(),
        "data": data,
        "results": [row for task in finished for row in _rows(config, task, done.values[task.name])],
        "modes": modes.tables,
        "failures": done.failures | modes.failures,
    }
    if results["results"]:
        write_results(config, out, results, finished)
    done.check("method")
    modes.check()
    return results


def benchmark_tasks(
    config: BenchmarkConfig,
    out: Path,
    *,
    source: str,
    only: Sequence[str] | None,
    predictions: Mapping[str, Path],
) -> list[MethodTask]:
    """A task for every garment and method, all checked before any work.

    Raises:
        InputError: a label that is not there, or a method's settings that are wrong.
    """
    labels = config.labels()
    for label in only or ():
        if label not in labels:
            raise InputError(f"{Option('methods')} {label}: no such method; there are {', '.join(labels)}")
    check_modes(config, source)
    tasks = []
    for data in config.data:
        common: dict[str, Any] = {
            "data": data, "fuse": config.fuse, "evaluate": config.evaluate, "threads": config.threads,
        }  # fmt: skip
        for number, method in enumerate(config.methods):
            label = label_of(method)
            content = run_content(config, data, method)
            parsed(content, f"{source}: methods.{number}")
            if only is None or label in only:
                tasks.append(
                    MethodTask(label=label, content=content, folder=out / data.name / label, **common)
                )
        for label, folder in predictions.items():
            if label in labels:
                raise InputError(
                    f"{Option('predictions')} {label}: a method is called so already; choose another name"
                )
            tasks.append(MethodTask(label=label, content=None, folder=folder, **common))
    return tasks


def write_results(
    config: BenchmarkConfig, out: Path, results: Mapping[str, Any], tasks: Sequence[MethodTask]
) -> None:
    """Write the files of a benchmark whose tasks are done."""
    out.mkdir(parents=True, exist_ok=True)
    with written_whole(out / RESULTS_FILE) as temporary:
        temporary.write_text(json.dumps(results, indent=1))
    for file, style in ((MARKDOWN_FILE, "github"), (LATEX_FILE, "latex_booktabs")):
        with written_whole(out / file) as temporary:
            temporary.write_text("\n".join(_sections(results, style)), encoding="utf-8")
    pictures = {data.name: list(_pictures(config, out, data, tasks)) for data in config.data}
    write_benchmark_page(out / PAGE_FILE, results, pictures)


def _pictures(
    config: BenchmarkConfig, out: Path, data: BenchmarkData, tasks: Sequence[MethodTask]
) -> Iterator[ClipPictures]:
    """Draw the test clips of a garment; their sheets are also files of their own."""
    if not config.pictures and not config.played:
        return
    (out / "pictures").mkdir(exist_ok=True)
    for ref in _refs(data, data.test):
        candidates = _candidates(tasks, data, ref)
        drawn = clip_pictures(ref.load(), candidates, shown=config.pictures, played=config.played)
        if drawn.sheet is not None:
            write_png(out / "pictures" / f"{data.name}__{folder_of_clip(ref.name)}.png", drawn.sheet)
        yield drawn


def _rows(config: BenchmarkConfig, task: MethodTask, result: MethodResult) -> list[dict[str, Any]]:
    """A row of the results for each variant of a method."""
    network = task.content is not None and task.content["method"].get("name") == NETWORK
    rows = []
    for variant, overall in result.overall.items():
        stages = ("predict",) if variant == "position_only" else ("predict", "maps", "fuse")
        clips = result.variants[variant]
        rows.append(
            {
                "data": result.data,
                "method": result.label,
                "variant": variant,
                "row": row_name(result.label, variant, network=network),
                "overall": overall,
                "interval": bootstrap_intervals(
                    clips, result.frames, resamples=config.resamples, seed=config.seed
                ),
                "clips": clips,
                "frames": result.frames,
                "parameters": result.parameters,
                "fit_seconds": result.fit_seconds,
                "ms": {stage: result.ms[stage] for stage in stages if stage in result.ms},
            }
        )
    return rows


def _candidates(tasks: Sequence[MethodTask], data: BenchmarkData, ref: ClipRef) -> list[Candidate]:
    candidates = []
    for task in tasks:
        if task.data.name == data.name:
            network = task.content is not None and task.content["method"].get("name") == NETWORK
            for variant, file in predicted_files(task, ref.name).items():
                candidates.append(Candidate(row_name(task.label, variant, network=network), file))
    return candidates


def data_facts(data: BenchmarkData) -> dict[str, Any]:
    """What the results say of the clips: their names, and one fingerprint of all of them."""
    train, test = _refs(data, data.train), _refs(data, data.test)
    both = sorted({ref.name for ref in train} & {ref.name for ref in test})
    if both:
        raise InputError(f"data {data.name}: {both[0]} is to be fitted to and measured; leave it out of one")
    clips = (ref.load() for ref in (*train, *test))
    return {
        "source": str(data.source),
        "train": [ref.name for ref in train],
        "test": [ref.name for ref in test],
        "fingerprint": clips_fingerprint(clips),
    }


def _refs(data: BenchmarkData, choice: ClipChoice) -> list[ClipRef]:
    return clip_refs(data.source, split=choice.split, names=choice.names, exclude=choice.exclude)


def _sections(results: Mapping[str, Any], style: str) -> list[str]:
    """The lines of a file of tables."""
    heading = "% " if style.startswith("latex") else "## "
    lines = []
    for name, facts in results["data"].items():
        lines += [
            f"{heading}{name}: {len(facts['train'])} clips to fit to, {len(facts['test'])} to measure",
            "",
        ]
        lines += [overall_table(results, name, style), "", clips_table(results, name, style), ""]
        for title, table in mode_tables(results, name, style):
            lines += [f"{heading}{name}: {title}", "", table, ""]
    return lines
