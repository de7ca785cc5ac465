"""The schemas of all commands, and every section that can stand in one."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import BaseModel

from imgtransfer.cli.config import COMMANDS, schema_of
from imgtransfer.config.field_words import models_of

SCHEMAS = {command: schema_of(command) for command in COMMANDS}


def all_models(schema: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A schema, and every section that can stand in it, as often as it can."""
    yield schema
    for field in schema.model_fields.values():
        for model in models_of(field.annotation):
            yield from all_models(model)
