"""YAML of people's files: plain values, no key twice, and no more and no deeper than a configuration can be."""

from __future__ import annotations

from typing import Any

import yaml

from render import InputError
from render.errors import one_line

MOST_BYTES = 1_000_000  # of text; ten thousand clips are half of it
MOST_VALUES = 100_000  # with what aliases repeat counted as often as they do
DEEPEST = 50  # levels of sections and lists
# What PyYAML raises for text that is none, and for values that their tags do not fit.
_FAULTS = (yaml.YAMLError, ValueError, KeyError, IndexError, AttributeError, TypeError, OverflowError)


class _Loader(yaml.SafeLoader):
    """Refuses a key that a mapping has twice, of which others take the last, and brackets without end."""

    def fetch_flow_collection_start(self, token: Any) -> None:
        if self.flow_level > DEEPEST:
            raise yaml.YAMLError(f"nested deeper than {DEEPEST} levels")
        super().fetch_flow_collection_start(token)

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        node: yaml.MappingNode = super().compose_mapping_node(anchor)
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                line = key.start_mark.line + 1
                if key.value in lines:
                    raise yaml.YAMLError(
                        f"{key.value} is there twice, in lines {lines[key.value]} and {line}"
                    )
                lines[key.value] = line
        return node


def load_bounded(text: str | bytes, source: str) -> Any:
    """What YAML text holds; `source` is what an InputError calls it.

    Raises:
        InputError: no YAML, text of more than 1 MB, a key twice, or values without end: nested, or repeated by aliases.
    """
    if len(text) > MOST_BYTES:
        raise InputError(f"{source}: {len(text)} bytes of text; a configuration has {MOST_BYTES} at most")
    try:
        content = yaml.load(text, _Loader)
    except RecursionError as error:
        raise InputError(f"{source}: nested deeper than {DEEPEST} levels; no configuration is") from error
    except _FAULTS as error:
        raise InputError(f"{source}: not YAML ({one_line(error)})") from error
    check_bounds(content, source)
    return content


def check_bounds(content: Any, source: str) -> None:
    """Raise InputError for content that is nested deeper, or holds more values, than a configuration can."""
    if _size(content, source, 0, {}) > MOST_VALUES:
        raise InputError(
            f"{source}: more than {MOST_VALUES} values, by aliases perhaps; no configuration has so many"
        )


def _size(value: Any, source: str, depth: int, known: dict[int, int]) -> int:
    """How many values there are, those behind an alias counted each time."""
    if not isinstance(value, dict | list | set | tuple):
        return 1
    if depth > DEEPEST:  # an alias to what it stands in comes here, too
        raise InputError(f"{source}: nested deeper than {DEEPEST} levels; no configuration is")
    if id(value) not in known:
        inner = [*value.keys(), *value.values()] if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_size(one, source, depth + 1, known) for one in inner)
    return known[id(value)]
