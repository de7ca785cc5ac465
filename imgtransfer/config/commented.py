"""A schema as YAML with comments: every key, what it means, what it takes, and its value."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from inspect import cleandoc
from textwrap import indent, wrap
from typing import Any, get_origin

import yaml
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from imgtransfer.config.field_words import depends_on, models_of, type_words, unit_of
from imgtransfer.config.loader import plain_values

_WIDTH = 100  # of a comment
_STEP = "  "


def commented_yaml(schema: type[BaseModel], config: BaseModel | None = None) -> str:
    """YAML that `load_config` reads back, with comments on every key: its meaning, and its type, range and unit.

    Args:
        config: whose values stand there, each with its default where that is another. None is the schema itself: all
            defaults, keys without one as comments, and every other kind of a section, and an item of every list, as
            comments that can be taken in.
    """
    about = "\n\n".join(" ".join(part.split()) for part in cleandoc(schema.__doc__ or "").split("\n\n"))
    return "\n".join([*_comment(about), "", *_Printer(config is None).section(schema, config, "")]) + "\n"


@dataclass(frozen=True)
class _Printer:
    """Prints sections.

    Attributes:
        examples: whether other kinds and items are shown.
        shown: where each model has been shown, by its key.
    """

    examples: bool
    shown: dict[type[BaseModel], str] = field(default_factory=dict)

    def section(self, schema: type[BaseModel], config: BaseModel | None, above: str) -> Iterator[str]:
        """The lines of a mapping; `config` None is the defaults, `above` the key that it is at, with a dot."""
        self.shown.setdefault(schema, above.rstrip("."))
        for name, entry in sorted(schema.model_fields.items(), key=lambda item: item[0] != "kind"):
            value = getattr(config, name) if config is not None else entry.get_default()
            unset = config is None or name not in config.model_fields_set
            yield from _comment(entry.description or "")
            facts = "; ".join(self._facts(entry, value))
            yield from _comment(f"[{facts}]" if facts else "")
            lines = self._entry(name, entry, value, above)
            yield from _as_comment(lines) if depends_on(entry) is not None and unset else lines
            if self.examples:
                yield from self._alternatives(name, entry, value, above)

    def _entry(self, name: str, entry: FieldInfo, value: Any, above: str) -> Iterator[str]:
        """The lines of a key and its value."""
        if _is_section(entry, value):
            given = value if isinstance(value, BaseModel) else None
            schema = next(models_of(entry.annotation)) if given is None else type(given)
            yield f"{name}:"
            yield from (indent(line, _STEP) for line in self.section(schema, given, f"{above}{name}."))
        elif value is PydanticUndefined:
            yield f"# {name}: ..."
        elif isinstance(value, tuple) and any(isinstance(item, BaseModel) for item in value):
            yield f"{name}:"
            yield from (f"{_STEP}- {_flow(plain_values(item))}" for item in value)
        else:
            yield f"{name}: {_flow(_plain(value))}"

    def _alternatives(self, name: str, entry: FieldInfo, value: Any, above: str) -> Iterator[str]:
        """What could stand in place of a key's value: other kinds of section, or items of a list, as comments."""
        for model in models_of(entry.annotation):
            if model in self.shown:
                continue
            item = get_origin(entry.annotation) is tuple
            yield "# Such as:" if item or value is None else "# Or in its place:"
            yield from _as_comment([f"{name}:", *([f"{_STEP}-"] if item else [])])
            lines = self.section(model, None, f"{above}{name}.")
            yield from _as_comment(indent(line, _STEP * (2 if item else 1)) for line in lines)

    def _facts(self, entry: FieldInfo, value: Any) -> Iterator[str]:
        """Type and range, unit, and what is to be known about the default."""
        unit, key = unit_of(entry), depends_on(entry)
        if not _is_section(entry, value):
            yield type_words(entry)
            if entry.is_required():
                yield "required"
            elif not self.examples and value != entry.default:
                yield f"default {_flow(_plain(entry.default))}"
        if unit is not None:
            yield unit
        if key is not None:
            yield f"depends on `{key}` where it is not given"
        known = [self.shown[model] for model in models_of(entry.annotation) if model in self.shown]
        if self.examples and known:
            yield f"as `{known[0]}`"


def _is_section(entry: FieldInfo, value: Any) -> bool:
    """Whether a key's value is a mapping of its own keys; one that is required is, too, but not a list of them."""
    required = value is PydanticUndefined and any(models_of(entry.annotation))
    return isinstance(value, BaseModel) or (required and get_origin(entry.annotation) is not tuple)


def _comment(text: str) -> Iterator[str]:
    for paragraph in filter(None, text.split("\n\n")):
        yield from _as_comment(wrap(paragraph, _WIDTH, break_long_words=False, break_on_hyphens=False))


def _as_comment(lines: Iterable[str]) -> Iterator[str]:
    return (f"# {line}" for line in lines)


def _plain(value: Any) -> Any:
    """A value as YAML has it."""
    if isinstance(value, BaseModel):
        return plain_values(value)
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _flow(value: Any) -> str:
    """A value on one line of YAML."""
    text = yaml.safe_dump(
        value, default_flow_style=True, width=float("inf"), sort_keys=False, allow_unicode=True
    )
    text = text.removesuffix("...\n").strip()
    return json.dumps(value) if "\n" in text else text
