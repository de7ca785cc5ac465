"""What the pages, the help and the committed files say of configurations is in the schemas."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest
import yaml
from pydantic import BaseModel, TypeAdapter

from imgtransfer.benchmark.config import BenchmarkConfig
from imgtransfer.benchmark.run import benchmark_tasks
from imgtransfer.cli.main import build_parser
from imgtransfer.config.field_words import kind_of, models_of
from imgtransfer.config.loader import load_config, read_yaml
from imgtransfer.deformers.config import run_schema
from imgtransfer.garments.config import DressConfig, SkirtConfig, TemplateConfig, TrousersConfig, TShirtConfig
from render import InputError
from tests.helpers.paths import ROOT
from tests.helpers.schemas import SCHEMAS, all_models

PAGES = {
    str(path.relative_to(ROOT)): path.read_text()
    for path in [
        ROOT / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        *sorted((ROOT / "configs").rglob("*.md")),
    ]
}
GARMENTS = (TShirtConfig, DressConfig, SkirtConfig, TrousersConfig, TemplateConfig)


MODELS = {model for schema in SCHEMAS.values() for model in all_models(schema)}


def has(schema: type[BaseModel], key: str) -> bool:
    """Whether a schema has a key such as clips.0.seed."""
    first, _, rest = key.partition(".")
    field = schema.model_fields.get(first)
    if field is None:
        return False
    rest = re.sub(r"^\d+\.?", "", rest)
    return not rest or any(has(model, rest) for model in models_of(field.annotation))


def takes(schema: type[BaseModel], content: dict[str, Any]) -> bool:
    """Whether these keys and values may stand in a section, whatever else it needs."""
    for name, value in content.items():
        field = schema.model_fields.get(name)
        if field is None:
            return False
        models = list(models_of(field.annotation))
        if isinstance(value, dict) and models:
            if not any(takes(model, value) for model in models):
                return False
        else:
            try:
                # Without the field itself, whose discriminator of sections no plain value has.
                plain = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
                TypeAdapter(plain).validate_python(value)
            except ValueError:
                return False
    return True


def changes() -> Iterator[tuple[str, str, str]]:
    """Every `--set KEY=VALUE` of the pages and the help: where it stands, key, value."""
    help_lines = [line for one in commands().values() for line in one.examples]
    help_lines += [action.help or "" for one in commands().values() for action in one._actions]
    for where, text in [*PAGES.items(), ("help", "\n".join(help_lines))]:
        for given in re.findall(r"--set ('[^']+'|[^\s`;,)]+)", text):
            (change,) = shlex.split(given)
            key, equals, value = change.partition("=")
            if equals and key.islower():  # not KEY=VALUE
                yield where, key, value


def commands() -> dict[str, Any]:
    (action,) = (action for action in build_parser()._actions if isinstance(action.choices, dict))
    return dict(action.choices)


def test_pages_and_help_show_changes() -> None:
    assert len(set(changes())) > 8


@pytest.mark.parametrize(("where", "key", "value"), sorted(set(changes())))
def test_what_is_set_on_a_page_can_be_set(where: str, key: str, value: str) -> None:
    assert value
    assert any(has(schema, key) for schema in SCHEMAS.values()), where


def settings() -> Iterator[tuple[str, str]]:
    """Settings in the text of the pages, such as `frame: body`."""
    for where, page in PAGES.items():
        text = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
        for inner in re.findall(r"`([^`]+)`", text):
            if re.fullmatch(r"[a-z_.]+: \S.*", " ".join(inner.split())):
                yield where, " ".join(inner.split())


def test_pages_show_settings() -> None:
    assert len(set(settings())) > 8


def test_a_setting_that_is_none_is_told() -> None:
    assert takes(SCHEMAS["train"], {"network": {"frame": "body"}})
    for wrong in (
        {"network": {"frame": "left"}},
        {"network": {"fram": "body"}},
        {"netwrk": {}},
        {"maps": {"layers": 0}},
    ):
        assert not takes(SCHEMAS["train"], wrong)
    assert has(SCHEMAS["simulate"], "clips.0.seed")
    assert not has(SCHEMAS["simulate"], "clips.0.sed")
    assert not has(SCHEMAS["fuse"], "solver.iterations")


@pytest.mark.parametrize(("where", "setting"), sorted(set(settings())))
def test_a_setting_on_a_page_is_one(where: str, setting: str) -> None:
    ((key, value),) = yaml.safe_load(setting).items()
    for name in reversed(key.split(".")):
        value = {name: value}
    assert any(takes(model, value) for model in MODELS), where


@pytest.mark.parametrize("where", PAGES)
def test_keys_with_their_section_are_keys(where: str) -> None:
    sections = {
        name
        for schema in SCHEMAS.values()
        for name, field in schema.model_fields.items()
        if any(models_of(field.annotation))
    }
    for key in re.findall(r"`([a-z_]+(?:\.\w+)+)`", PAGES[where]):
        first, *_ = key.split(".")
        if first in sections and not key.endswith((".md", ".yaml", ".npz", ".obj", ".zarr")):
            assert any(has(schema, key) for schema in SCHEMAS.values()), key


def test_the_table_of_garments_names_their_keys_and_no_others() -> None:
    page = PAGES["docs/data.md"]
    head, rows = re.findall(
        r"^\| \| (what can be set.*?) \|\n\| --- \| --- \|\n((?:\|.*\n)+)", page, re.MULTILINE
    )[0]
    common = set(re.findall(r"`(\w+)`", head))
    said: dict[str, set[str]] = {}
    for row in rows.splitlines():
        kinds, keys = row.strip("|").split("|")
        for kind in re.findall(r"`(\w+)`", kinds):
            said[kind] = set(re.findall(r"`(\w+)`", keys)) | (
                set() if "none of the others" in keys else common
            )
    assert said == {kind_of(garment): set(garment.model_fields) - {"kind"} for garment in GARMENTS}


def test_numbers_that_the_page_of_data_names_are_the_defaults() -> None:
    page, defaults = " ".join(PAGES["docs/data.md"].split()), SCHEMAS["simulate"]()
    solver, files = defaults.solver, defaults.files
    assert (
        f"for {solver.settle_seconds} s and follows it to the first frame for {solver.warm_up_seconds} s"
        in page
    )
    assert (
        f"more than {files.turning:,.0f} degrees a second, or a pelvis faster than {files.path_speed:.0f} m/s"
        in page
    )
    speed = defaults.sequences.speed
    assert f"faster than `speed` ({speed:.0f} m/s)" in " ".join(PAGES["docs/importing.md"].split())


def test_the_file_of_the_paper_states_the_defaults() -> None:
    """Its head says so; where the data lie is its own."""
    path = ROOT / "configs" / "paper.yaml"
    assert "All but the encoder\n# are also the defaults" in path.read_text()
    paper = load_config(SCHEMAS["train"], path)
    others = [f"data.source={paper.data.source}", "network.encoder={kind: hub}"]
    assert paper == load_config(SCHEMAS["train"], None, others)


@pytest.mark.parametrize("path", sorted((ROOT / "configs").rglob("*.yaml")), ids=lambda path: path.name)
def test_a_committed_file_is_of_one_kind(path: Any) -> None:
    taken = []
    for command, schema in SCHEMAS.items():
        try:
            load_config(run_schema(read_yaml(path)) if command == "train" else schema, path)
        except InputError:
            continue
        taken.append(command)
    assert taken == [
        {"data": "simulate", "benchmark": "benchmark", "ablation": "ablate"}.get(path.parent.name, "train")
    ]


@pytest.mark.parametrize(
    "path", sorted((ROOT / "configs" / "benchmark").glob("*.yaml")), ids=lambda path: path.name
)
def test_every_method_of_a_committed_benchmark_can_be_trained(path: Path) -> None:
    tasks = benchmark_tasks(
        load_config(BenchmarkConfig, path), Path("out"), source=str(path), only=None, predictions={}
    )
    assert len({task.name for task in tasks}) == len(tasks) > 3
