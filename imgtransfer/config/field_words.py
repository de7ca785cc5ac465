"""What a field of a schema takes, in words: its type, its range, its unit."""

from __future__ import annotations

import types
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types as bounds
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from imgtransfer.config.schema import NO_UNIT, DependsOn

_PLAIN = {bool: "true or false", str: "a text", Path: "a path", types.NoneType: "null"}


def models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    """The models among the alternatives and items of an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_of(part)


def paths_to(name: str, schema: type[BaseModel], above: str = "") -> Iterator[str]:
    """Where a schema has a key of this name, such as "training.steps"; keys of a list's items are left out."""
    for key, field in schema.model_fields.items():
        if key == name:
            yield f"{above}{key}"
        if get_origin(field.annotation) is not tuple:
            for model in models_of(field.annotation):
                yield from paths_to(name, model, f"{above}{key}.")


def kind_of(model: type[BaseModel]) -> Any:
    """The value of `kind` that chooses a model among others; None for one that is no such choice."""
    field = model.model_fields.get("kind")
    return None if field is None else field.default


def unit_of(field: FieldInfo) -> str | None:
    """ "m", "frames/s", ... or "no unit"; None for what is no quantity, and for numbers of what the key names."""
    unit = next((one.unit for one in _marks(field) if isinstance(one, bounds.Unit)), None)
    return "no unit" if unit == NO_UNIT else unit


def depends_on(field: FieldInfo) -> str | None:
    """The key beside it that a field depends on where it is not set."""
    return next((one.key for one in _marks(field) if isinstance(one, DependsOn)), None)


def type_words(field: FieldInfo) -> str:
    """What a field takes, such as "a number above 0 and up to 10, or null"."""
    return _words(field.annotation, list(field.metadata))


def number_words(field: FieldInfo | None) -> str:
    """The numbers that a field takes, such as "a whole number from 1 to 100"; a pair of such may do as well."""
    if field is None:
        return "a number"
    whole = int in (field.annotation, *get_args(field.annotation))
    several = any(get_origin(part) is tuple for part in get_args(field.annotation))
    return _number(whole, _marks(field)) + (
        " is wanted, or a list of two such numbers" if several else " is wanted"
    )


def _marks(field: FieldInfo) -> list[Any]:
    """What is annotated to a field and to the alternatives and items of its type."""
    return [*_flat(field.metadata), *_annotated(field.annotation)]


def _annotated(annotation: Any) -> Iterator[Any]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return
    if get_origin(annotation) is Annotated:
        yield from _flat(annotation.__metadata__)
        yield from _annotated(annotation.__origin__)
        return
    for part in get_args(annotation):
        yield from _annotated(part)


def _flat(metadata: Any) -> Iterator[Any]:
    """Constraints one by one; a `Field` inside `Annotated` holds its own."""
    for one in metadata:
        if isinstance(one, FieldInfo):
            yield from one.metadata
        else:
            yield one


def _words(annotation: Any, marks: list[Any]) -> str:
    """A type in words, with the constraints that hold for it."""
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _words(parts[0], [*marks, *_flat(parts[1:])])
    if annotation in (int, float):
        return _number(annotation is int, marks)
    if origin in (Literal, tuple):
        return _choice(parts) if origin is Literal else _list(parts, marks)
    if origin in (Union, types.UnionType):  # one phrase for all the models of a choice
        return ", or ".join(dict.fromkeys(_words(part, marks) for part in parts))
    return _PLAIN.get(annotation, "a mapping")


def _choice(values: tuple[Any, ...]) -> str:
    return f"one of {', '.join(map(str, values))}" if len(values) > 1 else f"only {values[0]}"


def _list(parts: tuple[Any, ...], marks: list[Any]) -> str:
    length = "" if parts[-1] is Ellipsis else f" of {len(parts)}"
    return f"a list{length}, each {_words(parts[0], marks)}"


def _number(whole: bool, marks: list[Any]) -> str:
    limits = []
    for constraint in dict.fromkeys(_flat(marks)):
        if isinstance(constraint, bounds.Gt):
            limits.append(f"above {constraint.gt:g}")
        elif isinstance(constraint, bounds.Ge):
            limits.append(f"from {constraint.ge:g} on")
        elif isinstance(constraint, bounds.Lt):
            limits.append(f"below {constraint.lt:g}")
        elif isinstance(constraint, bounds.Le):
            limits.append(f"up to {constraint.le:g}")
    number = "a whole number" if whole else "a number"
    return (
        f"{number} {' and '.join(limits)}".replace(" on and up to", " to").replace(" on and", " and").rstrip()
    )
