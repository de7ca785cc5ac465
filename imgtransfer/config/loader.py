"""Configurations: from a YAML file and `--set`, or from either alone, to checked settings, and back to YAML.

Every command that takes a configuration reads it through here, so that they understand the same and complain alike.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from reprlib import repr as shortened
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from imgtransfer.config.bounded_yaml import DEEPEST, MOST_BYTES, check_bounds, load_bounded
from imgtransfer.config.field_words import depends_on
from imgtransfer.config.validation_messages import first_mistake
from render import InputError, Option
from render.files.atomic import check_regular

Model = TypeVar("Model", bound=BaseModel)


def load_config(
    model: type[Model],
    path: str | Path | None = None,
    changes: Sequence[str] = (),
    *,
    wanted: str | None = None,
) -> Model:
    """Read a configuration.

    Args:
        model: what it must be; what is not said is the model's default.
        path: the file; None is an empty one.
        changes: "section.key=value" each, the value as YAML; they replace or add what the file says.
        wanted: what the file should be, for the message when it is not there; None is the model's title.

    Raises:
        InputError: no such file, not YAML, an unknown key, a value out of its range, or a change that fits nowhere.
    """
    wanted = wanted or model.model_config.get("title") or "a YAML file of settings"
    content = {} if path is None else read_yaml(path, wanted)
    return parse_config(model, content, str(Option("changes") if path is None else path), changes)


def parse_config(model: type[Model], content: Any, source: str, changes: Sequence[str] = ()) -> Model:
    """Check the parsed content of a configuration, changed by `changes`.

    Args:
        source: what an InputError calls the content.

    Raises:
        InputError: as for `load_config`.
    """
    content = {} if content is None else content
    if not isinstance(content, dict):
        kind = "a list" if isinstance(content, list) else f"only {shortened(content)}"
        raise InputError(f"{source}: a mapping of settings is wanted, found {kind}")
    content = with_changes(content, changes)
    check_bounds(content, source)
    try:
        return model.model_validate(content)
    except ValidationError as error:
        key, text = first_mistake(error, model, content)
        changed = [change for change in changes if _concerns(change, key)]
        place = f"{Option('changes')} {changed[-1]}" if changed else source
        raise InputError(f"{place}: {text}") from error


def to_yaml(config: BaseModel) -> str:
    """All values, the defaults too, as YAML that `load_config` reads back."""
    return yaml.safe_dump(plain_values(config), sort_keys=False)


def plain_values(config: BaseModel) -> dict[str, Any]:
    """All values as YAML has them, without those that depend on another key and are not set."""
    values: dict[str, Any] = config.model_dump(mode="json")
    for name, field in type(config).model_fields.items():
        if name not in config.model_fields_set and depends_on(field) is not None:
            del values[name]
            continue
        value = getattr(config, name)
        if isinstance(value, BaseModel):
            values[name] = plain_values(value)
        elif isinstance(value, tuple) and any(isinstance(item, BaseModel) for item in value):
            values[name] = [plain_values(item) for item in value]
    return values


def read_yaml(path: str | Path, wanted: str = "a YAML file") -> Any:
    """What a YAML file holds: plain values only, whatever its tags say.

    Args:
        wanted: what the file should be, for the message when it is not there.

    Raises:
        InputError: no such file, or not YAML.
    """
    path = Path(path)
    check_regular(path, wanted)
    with path.open("rb") as file:
        return load_bounded(file.read(MOST_BYTES + 1), str(path))


def with_changes(content: dict[Any, Any], changes: Sequence[str]) -> dict[Any, Any]:
    """A copy of a configuration's content in which `changes`, "section.key=value" each, are made in turn.

    A section that is not there is added; an item of a list is named by its number from 0: "clips.0.seed=3".

    Raises:
        InputError: a change without a key or "=", a value that is not YAML, or a key inside what is no section.
    """
    content = copy.deepcopy(content) if changes else content
    for change in changes:
        key, equals, value = change.partition("=")
        names = key.strip().split(".")
        if not equals or not all(names) or len(names) > DEEPEST:
            raise InputError(
                f"{Option('changes')} {change}: section.key=value is wanted, such as training.steps=100"
            )
        section: Any = content
        for name in names[:-1]:
            place = _place(section, name, change)
            if isinstance(section, dict) and section.get(place) is None:
                section[place] = {}
            section = section[place]
        section[_place(section, names[-1], change)] = load_bounded(value, f"{Option('changes')} {change}")
    return content


def _place(section: Any, name: str, change: str) -> str | int:
    """The key of a mapping, or the index in a list, that a part of a change's key stands for."""
    if isinstance(section, dict):
        return name
    if not isinstance(section, list):
        raise InputError(
            f"{Option('changes')} {change}: {name} is wanted of {shortened(section)}, which is not a section"
        )
    if name.isdecimal() and len(name) < 10 and int(name) < len(section):
        return int(name)
    raise InputError(
        f"{Option('changes')} {change}: there are {len(section)} items, counted from 0, and no {name} among them"
    )


def _concerns(change: str, key: str) -> bool:
    """Whether a change is at the key of a mistake, above it or below."""
    one, other = f"{change.partition('=')[0].strip()}.", f"{key}."
    return bool(key) and (one.startswith(other) or other.startswith(one))
