"""The sections of a benchmark beyond its one table: robustness, data sizes, variants of a setting, roll-outs."""

from __future__ import annotations

import glob
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from imgtransfer.benchmark.config import BenchmarkConfig, Variants, label_of, parsed, run_content
from imgtransfer.benchmark.measure import MethodResult, MethodTask, measure
from imgtransfer.benchmark.probes import ProbeTask, probe
from imgtransfer.data.source import clip_refs
from imgtransfer.deformers.registry import NETWORK
from imgtransfer.running import Executor, run_tasks
from render import InputError


@dataclass
class Modes:
    """What came of the sections.

    Args:
        tables: by section, a list of {"data", "method", ...} as results.json has them.
        failures: by task, why it failed.
    """

    tables: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    def check(self) -> None:
        """Raise InputError where a task failed."""
        if self.failures:
            name, reason = next(iter(self.failures.items()))
            raise InputError(f"{len(self.failures)} failed of the further measures; {name}: {reason}")


def check_modes(config: BenchmarkConfig, source: str) -> None:
    """Raise InputError where a variant is none that its method can have, before any work."""
    for number, one in enumerate(config.variants):
        for value in one.values:
            content = run_content(config, config.data[0], _varied(config, one, value))
            parsed(content, f"{source}: variants.{number}")


def run_modes(
    config: BenchmarkConfig,
    tasks: Sequence[MethodTask],
    done: Mapping[str, MethodResult],
    *,
    executor: Executor,
) -> Modes:
    """Fit and measure what the sections ask for of methods that are done.

    Args:
        tasks: that are done, clips of other programs among them, which are passed over.
        done: their results by name.
        executor: where it is worked on.
    """
    modes, fitted = Modes(), [task for task in tasks if task.content is not None]
    probes = [
        ProbeTask(fit=task, robustness=config.robustness, seed=config.seed)
        for task in fitted
        if config.robustness is not None
    ] + [ProbeTask(fit=task, rollouts=config.rollouts) for task in fitted if config.rollouts]
    again = _size_tasks(config, fitted) + _variant_tasks(config, fitted)
    fits = {task.name: task for _, _, task in again}
    measured = run_tasks(
        measure, list(fits.values()), executor=executor, name=_name, say=MethodResult.line, unit="fit"
    )
    probed = run_tasks(probe, probes, executor=executor, name=_name, say=_nothing, unit="measure")
    modes.failures = measured.failures | probed.failures
    for asked in probes:
        if values := probed.values.get(asked.name):
            row = {"data": asked.fit.data.name, "method": asked.fit.label, "values": values}
            modes.tables.setdefault(asked.kind, []).append(row)
    for section, key, task in again:
        if task.name in measured.values:
            row = _row(task, measured.values[task.name], key)
            modes.tables.setdefault(section, []).append(row)
    if config.data_sizes:
        whole = [_row(task, done[task.name], {"size": 1.0, "clips": _count(task)}) for task in fitted]
        modes.tables.setdefault("data_sizes", []).extend(whole)
    return modes


def _size_tasks(
    config: BenchmarkConfig, fitted: Sequence[MethodTask]
) -> list[tuple[str, dict[str, Any], MethodTask]]:
    """A fit to a part of the training clips; sizes that come to the same number of clips are one."""
    tasks = []
    for task in fitted:
        data = task.data
        refs = clip_refs(
            data.source, split=data.train.split, names=data.train.names, exclude=data.train.exclude
        )
        order = np.random.default_rng(config.seed).permutation(len(refs))
        counts = {math.ceil(size * len(refs)): size for size in sorted(config.data_sizes)}
        for count, size in counts.items():
            if count == len(refs):
                continue
            names = tuple(sorted(glob.escape(refs[index].name) for index in order[:count]))
            part = data.model_copy(update={"train": data.train.model_copy(update={"names": names})})
            assert task.content is not None
            content = task.content | {
                "data": task.content["data"] | {"train": part.train.model_dump(mode="json")}
            }
            smaller = replace(
                task,
                label=f"{task.label}, {count} of {len(refs)} clips",
                data=part,
                content=content,
                folder=task.folder / "sizes" / str(count),
            )
            tasks.append(("data_sizes", {"method": task.label, "size": size, "clips": count}, smaller))
    return tasks


def _variant_tasks(
    config: BenchmarkConfig, fitted: Sequence[MethodTask]
) -> list[tuple[str, dict[str, Any], MethodTask]]:
    tasks = []
    for one in config.variants:
        for task in fitted:
            if task.label != one.method:
                continue
            for value in one.values:
                content = run_content(config, task.data, _varied(config, one, value))
                assert task.content is not None
                # Of their contents: the schema of a method is another class whenever it is asked for.
                same = parsed(content, task.name).model_dump() == parsed(task.content, task.name).model_dump()
                varied = replace(
                    task,
                    label=f"{one.method}, {one.setting} {value}",
                    content=content,
                    folder=task.folder if same else task.folder / "variants" / _file_name(one, value),
                )
                key = {"method": one.method, "setting": one.setting, "value": value}
                tasks.append(("variants", key, varied))
    return tasks


def _varied(config: BenchmarkConfig, one: Variants, value: object) -> dict[str, Any]:
    """The settings of a method with another value of one of them."""
    method = next(method for method in config.methods if label_of(method) == one.method)

    def changed(settings: Any, keys: Sequence[str]) -> dict[str, Any]:
        below = settings.get(keys[0]) if isinstance(settings, dict) else None
        new = value if len(keys) == 1 else changed(below, keys[1:])
        return (settings if isinstance(settings, dict) else {}) | {keys[0]: new}

    return changed(method, one.setting.split("."))


def _file_name(one: Variants, value: object) -> str:
    return re.sub(r"[^A-Za-z0-9_.+=-]", "_", f"{one.setting}={value}")


def _row(task: MethodTask, result: MethodResult, key: Mapping[str, Any]) -> dict[str, Any]:
    assert task.content is not None
    return {
        "data": task.data.name,
        "method": task.label,
        **key,
        "network": task.content["method"].get("name") == NETWORK,
        "overall": result.overall,
        "parameters": result.parameters,
        "fit_seconds": result.fit_seconds,
    }


def _count(task: MethodTask) -> int:
    choice = task.data.train
    return len(clip_refs(task.data.source, split=choice.split, names=choice.names, exclude=choice.exclude))


def _name(task: MethodTask | ProbeTask) -> str:
    return task.name


def _nothing(_: object) -> str:
    return ""
