"""What is wrong in a configuration, in one line: the key as the user wrote it, what is there, what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from reprlib import repr as shortened
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from imgtransfer.config.field_words import kind_of, models_of, number_words, paths_to

_NUMBERS = ("float_type", "float_parsing", "int_type", "int_parsing", "int_from_float", "finite_number")
_RANGES = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_KINDS = {
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "string_type": "a text",
    "path_type": "a path",
    "tuple_type": "a list",
    "list_type": "a list",
    "string_pattern_mismatch": "a name of letters, digits, '_', '-' and '.'",
    "union_tag_invalid": "a mapping of settings, such as {kind: ...},",
    "model_type": "a mapping of settings",
    "model_attributes_type": "a mapping of settings",
}


def first_mistake(
    error: ValidationError, model: type[BaseModel], given: Mapping[str, Any]
) -> tuple[str, str]:
    """The first mistake that a model found in what a file holds.

    Args:
        error: raised by `model` for `given`.

    Returns:
        Its key, such as "solver.iterations" ("" for the whole), and a line that starts with it and says what is wrong.
    """
    # A key that does not exist tells more than the missing one that it was meant to be.
    mistakes = sorted(error.errors(), key=lambda one: one["type"] == "missing")
    mistake = mistakes[0]
    keys, holder, value = _place(model, given, mistake["loc"])
    unknown = mistake["type"] == "extra_forbidden"
    text = _unknown(keys, holder, model) if unknown else _wrong(mistake, keys, holder, value)
    others = {_place(model, given, other["loc"])[0] for other in mistakes} - {keys}
    more = f" (and {len(others)} more)" if others else ""
    key = ".".join(str(part) for part in keys)
    return key, f"{key}: {text}{more}" if key else f"{text}{more}"


def _place(
    model: type[BaseModel], given: Any, loc: tuple[int | str, ...]
) -> tuple[tuple[int | str, ...], type[BaseModel], Any]:
    """The keys as the file has them (pydantic adds the names of alternatives), the model that holds the last one, and
    what the file has there.
    """
    keys: list[int | str] = []
    holder = model
    inner: list[type[BaseModel]] = []
    for number, part in enumerate(loc):
        there = (isinstance(given, Mapping) and part in given) or (
            isinstance(given, list) and isinstance(part, int) and part < len(given)
        )
        chosen = [one for one in inner if kind_of(one) == part] if not there else []
        if isinstance(part, str) and len(inner) == 1:
            chosen = inner
        if chosen:
            holder, inner = chosen[0], []
        missing = number == len(loc) - 1 and isinstance(given, Mapping) and part in holder.model_fields
        if not (there or missing):
            continue  # the name of an alternative, such as template, float or tuple
        if isinstance(part, str):
            field = holder.model_fields.get(part)
            inner = [] if field is None else list(models_of(field.annotation))
        keys.append(part)
        given = given[part] if there else None
    return tuple(keys), holder, given


def _unknown(keys: tuple[int | str, ...], holder: type[BaseModel], model: type[BaseModel]) -> str:
    """What to say of a key that its section does not have: a similar one, or where the configuration has it."""
    section, name = _section(keys, holder), str(keys[-1])
    names = sorted(set(holder.model_fields) - {"kind"})
    here = ".".join(str(key) for key in keys)
    elsewhere = [path for path in paths_to(name, model) if path != here]
    meant = (get_close_matches(name, names, n=1) or elsewhere)[:1]
    hint = f", did you mean {meant[0]}? There" if meant else "; there"
    return f"no such setting{f' of {section}' if section else ''}{hint} are {', '.join(names)}"


def _section(keys: tuple[int | str, ...], holder: type[BaseModel]) -> str:
    """What to call the section that a key is in; nothing for the whole."""
    return kind_of(holder) or next((str(key) for key in keys[-2::-1] if isinstance(key, str)), "")


def _wrong(mistake: Any, keys: tuple[int | str, ...], holder: type[BaseModel], value: Any) -> str:
    """What is wrong with the value of a key, or with a choice between alternatives."""
    kind, context = mistake["type"], mistake.get("ctx", {})
    if kind == "missing":
        return f"missing; {_section(keys, holder) or 'the configuration'} needs it"
    if kind == "union_tag_invalid" and isinstance(value, Mapping):
        return f"no kind {value.get('kind')!r}; there are {context['expected_tags'].replace(chr(39), '')}"
    if kind == "value_error":
        return str(context["error"])
    return (
        f"{_wanted(mistake, holder.model_fields.get(str(keys[-1])) if keys else None)}, found {_shown(value)}"
    )


def _shown(value: Any) -> str:
    """A value as it stands in YAML, cut short."""
    return (
        {None: "null", True: "true", False: "false"}[value]
        if value is None or isinstance(value, bool)
        else shortened(value)
    )


def _wanted(mistake: Any, field: FieldInfo | None) -> str:
    """What kind of value a setting takes."""
    kind, context = mistake["type"], mistake.get("ctx", {})
    if kind == "literal_error":
        return f"one of {context['expected'].replace(chr(39), '').replace(' or ', ', ')} is wanted"
    if kind in _RANGES or kind in _NUMBERS:
        return number_words(field)
    if kind in _KINDS:
        return f"{_KINDS[kind]} is wanted"
    return f"{mistake['msg'][:1].lower()}{mistake['msg'][1:]}"
