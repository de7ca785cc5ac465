"""The configuration of a method's fit: a section `method` in place of the network's, under the same `data`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

from pydantic import ConfigDict, Field, create_model

from imgtransfer.config.loader import parse_config, read_yaml, with_changes
from imgtransfer.config.schema import Section
from imgtransfer.deformers.base import Deformer
from imgtransfer.deformers.registry import NETWORK, deformer_class
from imgtransfer.training.config import ClipChoice, DataConfig, RunConfig
from render import InputError, Option

_WANTED = RunConfig.model_config.get("title") or ""


class MethodData(Section):
    """The clips that a method is fitted to."""

    source: Path = Field(
        description="A data set folder, a folder of clip npz files or one such file; relative to the working folder."
    )
    train: ClipChoice = Field(
        ClipChoice(split="train"), description="The clips to fit to, all of one garment."
    )


class MethodRunConfig(Section):
    """One fit of a method that predicts garments (`imgtransfer.deformers`)."""

    model_config = ConfigDict(title=_WANTED)

    data: MethodData = Field(description="The clips.")
    method: Section = Field(description="The method: its name, and its own settings.")
    seed: int = Field(0, ge=0, lt=2**31, description="Of all that is random.")
    threads: int | None = Field(
        None, ge=1, le=1024, description="CPU threads; null leaves the choice to the environment."
    )

    @property
    def name(self) -> str:
        """The method's."""
        return str(getattr(self.method, "name"))  # noqa: B009 (every schema of `method_section` has it)


def method_section(name: Any) -> type[Section]:
    """The schema of a section `method` with this name: the method's own settings, and the name.

    Raises:
        InputError: no such method.
    """
    kind = deformer_class(name).Config
    wanted: Any = Literal[name]
    field: Any = (wanted, Field(name, description="Which method."))
    return cast(
        "type[Section]",
        create_model(f"{kind.__name__}Section", __base__=kind, __doc__=kind.__doc__, name=field),
    )


def run_schema(content: Any) -> type[RunConfig] | type[MethodRunConfig]:
    """What a training's configuration must be: the network's where it has no `method`, else that method's.

    Args:
        content: of the file.

    Raises:
        InputError: a `method` that is no section, or has no name of a method.
    """
    if not isinstance(content, Mapping) or "method" not in content:
        return RunConfig
    method = content["method"]
    if not isinstance(method, Mapping) or "name" not in method:
        raise InputError("method: a section with the name of a method is wanted, such as {name: lbs}")
    return schema_of_method(method["name"])


def schema_of_method(name: Any) -> type[MethodRunConfig]:
    """The schema of a fit of one method.

    Raises:
        InputError: no such method.
    """
    section = method_section(name)
    data = DataConfig if name == NETWORK else MethodData
    schema: type[MethodRunConfig] = create_model(
        "MethodRunConfig",
        __base__=MethodRunConfig,
        __doc__=MethodRunConfig.__doc__,
        data=(data, Field(description="The clips.")),
        method=(section, Field(description=(section.__doc__ or "").split("\n\n", maxsplit=1)[0])),
    )
    return schema


def load_run_config(path: str | Path | None, changes: Sequence[str] = ()) -> RunConfig | MethodRunConfig:
    """Read the configuration of a training: of the network's, or of a method's.

    Raises:
        InputError: as `imgtransfer.config.loader.load_config`; no such method.
    """
    content = {} if path is None else read_yaml(path, _WANTED)
    return parse_run_config(content, str(Option("changes") if path is None else path), changes)


def parse_run_config(content: Any, source: str, changes: Sequence[str] = ()) -> RunConfig | MethodRunConfig:
    """Check the content of a training's configuration; see `load_run_config`.

    Args:
        source: what an InputError calls the content.
    """
    changed = with_changes(content, changes) if isinstance(content, dict) else content
    try:
        schema = run_schema(changed)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return parse_config(schema, content, source, changes)


def make_deformer(config: MethodRunConfig) -> Deformer:
    """The method of a configuration, not fitted yet."""
    kind = deformer_class(config.name)
    return kind(kind.Config.model_validate(config.method.model_dump(exclude={"name"})))
