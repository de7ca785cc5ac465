"""Every key of every schema is printed with what it means and takes, as YAML that reads back as the same."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal, get_origin

import pytest
import yaml
from annotated_types import Unit
from pydantic import BaseModel, Field

from imgtransfer.cli.config import COMMANDS
from imgtransfer.config.commented import commented_yaml
from imgtransfer.config.field_words import depends_on, models_of, type_words, unit_of
from imgtransfer.config.loader import load_config, parse_config, plain_values, read_yaml, to_yaml
from imgtransfer.config.schema import DependsOn, Section
from imgtransfer.deformers.config import run_schema
from tests.helpers.paths import ROOT
from tests.helpers.schemas import SCHEMAS, all_models

MODELS = {model.__name__: model for schema in SCHEMAS.values() for model in all_models(schema)}
FIELDS = [
    pytest.param(model, name, id=f"{model.__name__}.{name}")
    for model in MODELS.values()
    for name in model.model_fields
]


def uncommented(text: str) -> str:
    """YAML without the comments that are text: keys that stand as comments are keys."""
    lines = []
    for line in text.splitlines():
        bare = re.sub(r"^( *)((?:# )*)(?= *(?:\w+:( |$)|-( |$)))", lambda match: match[1], line)
        if not bare.lstrip().startswith("#"):
            lines.append(bare)
    return "\n".join(lines)


# A small schema, whose whole output is known


class Pedal(Section):
    """A pedal."""

    kind: Literal["pedal"] = Field("pedal", description="Pedals.")
    width: Annotated[float, Unit("m")] = Field(0.1, gt=0, lt=1, description="Across.")


class Motor(Section):
    """A motor."""

    kind: Literal["motor"] = Field("motor", description="A motor.")
    maker: str = Field(description="Who made it.")


class Bell(Section):
    """A bell."""

    loud: bool = Field(False, description="Whether it is heard.")


class Bicycle(Section):
    """A bicycle,
    in short.
    """

    drive: Annotated[Pedal | Motor, Field(discriminator="kind")] = Field(
        Pedal(), description="What drives it."
    )
    grade: Literal["a", "b"] = Field("a", description="How good it is.")
    mass: Annotated[float, Unit("kg"), DependsOn("grade")] = Field(9.0, gt=0, description="With everything.")
    gears: tuple[int, ...] = Field((1, 2), description="Teeth.")
    bells: tuple[Bell, ...] = Field((), description="On the bar.")


BICYCLE = """\
# A bicycle, in short.

# What drives it.
drive:
  # Pedals.
  # [only pedal]
  kind: pedal
  # Across.
  # [a number above 0 and below 1; m]
  width: 0.1
# Or in its place:
# drive:
#   # A motor.
#   # [only motor]
#   kind: motor
#   # Who made it.
#   # [a text; required]
#   # maker: ...
# How good it is.
# [one of a, b]
grade: a
# With everything.
# [a number above 0; kg; depends on `grade` where it is not given]
# mass: 9.0
# Teeth.
# [a list, each a whole number]
gears: [1, 2]
# On the bar.
# [a list, each a mapping]
bells: []
# Such as:
# bells:
#   -
#     # Whether it is heard.
#     # [true or false]
#     loud: false
"""


def test_a_schema_is_printed_whole() -> None:
    assert commented_yaml(Bicycle) == BICYCLE


def test_a_configuration_is_printed_with_the_defaults_that_it_leaves() -> None:
    given = {"drive": {"kind": "motor", "maker": "x\ny"}, "mass": 3, "bells": [{"loud": True}, {}]}
    bicycle = parse_config(Bicycle, given, "here")
    text = commented_yaml(Bicycle, bicycle)
    assert 'maker: "x\\ny"' in text
    assert (
        "# [a number above 0; default 9.0; kg; depends on `grade` where it is not given]\nmass: 3.0" in text
    )
    assert "bells:\n  - {loud: true}\n  - {loud: false}" in text
    assert "Or in its place" not in text
    assert parse_config(Bicycle, yaml.safe_load(text), "printed") == bicycle


def test_values_that_depend_on_another_key_are_kept_only_where_they_are_set() -> None:
    assert plain_values(Bicycle()) == {
        "drive": {"kind": "pedal", "width": 0.1},
        "grade": "a",
        "gears": [1, 2],
        "bells": [],
    }
    assert plain_values(Bicycle(mass=2))["mass"] == 2


# Every schema of the project


@pytest.mark.parametrize(("model", "name"), FIELDS)
def test_a_field_says_what_it_means_and_takes(model: type[BaseModel], name: str) -> None:
    field = model.model_fields[name]
    assert field.description
    assert field.description.endswith(".")
    words = type_words(field)
    if "number" in words:
        assert any(word in words for word in ("above", "from", "below", "up to")) or name in (
            "betas",
            "values",
        )
    if "a number" in words and name != "values":  # whole numbers count what they are named for
        assert unit_of(field) is not None
    key = depends_on(field)
    assert key is None or key in model.model_fields


@pytest.mark.parametrize("model", MODELS.values(), ids=list(MODELS))
def test_a_section_says_what_it_is_and_refuses_what_it_does_not_know(model: type[BaseModel]) -> None:
    assert model.__doc__
    assert model.model_config["extra"] == "forbid"
    assert model.model_config["frozen"]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_of_a_schema_is_printed_with_its_default_description_and_range(command: str) -> None:
    text = commented_yaml(SCHEMAS[command])
    plain = " ".join(line.strip().lstrip("# ") for line in text.splitlines())
    for model in dict.fromkeys(all_models(SCHEMAS[command])):
        for name, field in model.model_fields.items():
            assert re.search(rf"^[ #-]*{name}:", text, re.MULTILINE), f"{model.__name__}.{name}"
            assert f" {field.description}" in f" {plain}", f"{model.__name__}.{name}"
            section = isinstance(field.default, BaseModel) or (
                field.is_required()
                and any(models_of(field.annotation))
                and get_origin(field.annotation) is not tuple
            )
            unit = unit_of(field)
            facts = (
                type_words(field)
                + ("; required" if field.is_required() else "")
                + (f"; {unit}" if unit else "")
            )
            assert section or f"[{facts}" in plain, f"{model.__name__}.{name}"
    # Without what is only shown as a comment, and with what is required, it is the defaults.
    content = yaml.safe_load(text)
    needed = {
        "train": {"data": {"source": "x"}},
        "benchmark": {"data": [{"name": "shirt", "source": "x"}], "methods": [{"name": "lbs"}]},
        "ablate": {"data": {"source": "x"}, "rows": [{"label": "whole"}]},
    }.get(command, {})
    for key, values in needed.items():
        content[key] = content[key] | values if key in content else values
    assert parse_config(SCHEMAS[command], content, "printed") == parse_config(
        SCHEMAS[command], needed, "defaults"
    )


def test_every_kind_of_garment_and_body_can_be_taken_in() -> None:
    text = commented_yaml(SCHEMAS["simulate"])
    blocks = re.findall(
        r"^# Or in its place:\n((?:# .*\n)+?)(?=# Or in its place:|[^#]|# \w)", text, re.MULTILINE
    )
    kinds = set()
    for block in blocks:
        key, values = next(iter(yaml.safe_load(uncommented(block)).items()))
        kinds.add(values["kind"])
        if values["kind"] in ("smpl", "template"):
            values["path"] = "x"
        values.pop("unit", None)
        parse_config(SCHEMAS["simulate"], {key: values}, "block")
    assert kinds == {"smpl", "dress", "trousers", "skirt", "template"}


CONFIGURATIONS = [
    pytest.param(path, id=str(path.relative_to(ROOT))) for path in sorted((ROOT / "configs").rglob("*.yaml"))
]


@pytest.mark.parametrize("path", CONFIGURATIONS)
def test_committed_configurations_read_back_as_they_are_printed(path: Path) -> None:
    command = {"data": "simulate", "benchmark": "benchmark", "ablation": "ablate"}.get(
        path.parent.name, "train"
    )
    schema = run_schema(read_yaml(path)) if command == "train" else SCHEMAS[command]
    config = load_config(schema, path)
    for text in (commented_yaml(schema, config), to_yaml(config)):
        assert parse_config(schema, yaml.safe_load(text), "printed") == config


def test_what_excludes_each_other_reads_back() -> None:
    given = {
        "garment": {"kind": "template", "path": "a.obj", "scale": 0.5},
        "sequences": {"unit": "cm"},
        "cloth": {"fabric": "silk", "density": 0.1},
        "gates": {"speed": float("inf")},
    }
    config = parse_config(SCHEMAS["simulate"], given, "here")
    for text in (commented_yaml(SCHEMAS["simulate"], config), to_yaml(config)):
        assert parse_config(SCHEMAS["simulate"], yaml.safe_load(text), "printed") == config
