"""What a data set's metadata files may say: checked once, with the file and the key in the message."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from imgtransfer.data.place import METADATA, Place
from imgtransfer.data.schema import ARRAYS, FORMAT, REQUIRED_ARRAYS, check_root
from render import InputError
from render.limits import FASTEST, SLOWEST

_LARGEST_CHUNK = 2**31 - 1  # bytes; no encoder writes more
_LARGEST_AXIS = 2**40
_TYPES = Literal[
    "float16", "float32", "float64", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64",
]  # fmt: skip
_CODECS = (("bytes",), ("blosc", "zstd"), ("crc32c",))  # in this order, all but the first may be missing
Model = TypeVar("Model", bound=BaseModel)


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class RootAttributes(_Strict):
    """Of a data set; `check_root` has seen its format and version."""

    schema_version: int
    title: str = ""
    source: str = ""
    licence: str = ""


class ClipAttributes(_Strict):
    """Of a clip's group; `arrays` is None in version 1, which did not list them."""

    split: str = Field(min_length=1, max_length=1000)
    fps: float = Field(ge=SLOWEST, le=FASTEST)
    frames: int = Field(ge=1, le=_LARGEST_AXIS)
    arrays: list[str] | None = None
    info: dict[str, str]
    licence: str = ""
    schema_version: int = Field(default=1, ge=1)

    @field_validator("arrays")
    @classmethod
    def _known(cls, names: list[str] | None) -> list[str] | None:
        unknown = [name for name in names or () if name not in ARRAYS]
        if unknown:
            raise ValueError(f"no clip has an array {unknown[0][:100]!r}")
        if names is not None and len(set(names)) < len(names):
            raise ValueError("an array is listed twice")
        lacking = [] if names is None else [name for name in REQUIRED_ARRAYS if name not in names]
        if lacking:
            raise ValueError(f"lacks {', '.join(lacking)}")
        return names


class Rejection(_Strict):
    """Of a clip that was made and not taken in."""

    name: str
    reason: str
    made: str


class _Codec(_Strict):
    name: str
    configuration: dict[str, Any] = {}


class _Grid(_Strict):
    class Shape(_Strict):
        chunk_shape: list[int]

    name: Literal["regular"]
    configuration: Shape


class _Keys(_Strict):
    class Separator(_Strict):
        separator: Literal["/", "."] = "/"

    name: Literal["default"]
    configuration: Separator = Separator()


class _Encoding(_Strict):
    """Attributes of an array; `grid.STEP` is what is written, other steps are read too."""

    encoding: Literal["second-differences", "second-differences-by-chunk"] | None = None
    step: float | None = Field(default=None, gt=0, le=1)


class ArrayMetadata(_Strict):
    """Of a Zarr v3 array as this program reads it; anything else of the format is refused."""

    zarr_format: Literal[3]
    node_type: Literal["array"]
    shape: list[int] = Field(min_length=1, max_length=4)
    data_type: _TYPES
    chunk_grid: _Grid
    chunk_key_encoding: _Keys
    codecs: list[_Codec] = Field(min_length=1, max_length=16)
    fill_value: float | int | str
    attributes: _Encoding = _Encoding()
    storage_transformers: list[None] = Field(default=[], max_length=0)

    @model_validator(mode="after")
    def _fits(self) -> ArrayMetadata:
        chunks = self.chunk_grid.configuration.chunk_shape
        if any(not 0 <= length <= _LARGEST_AXIS for length in self.shape):
            raise ValueError(f"shape {self.shape} is of no array")
        if len(chunks) != len(self.shape) or any(not 1 <= length <= _LARGEST_AXIS for length in chunks):
            raise ValueError(f"chunks of shape {chunks} do not divide an array of shape {self.shape}")
        if self.chunk_bytes > _LARGEST_CHUNK:
            raise ValueError(f"chunks of shape {chunks} are larger than 2 GiB")
        names = [codec.name for codec in self.codecs]
        rest = list(names)
        for kinds in _CODECS:
            if rest and rest[0] in kinds:
                del rest[0]
        if rest or names[0] != "bytes":
            raise ValueError(f"codecs {', '.join(names)[:200]}; bytes, blosc or zstd, and crc32c are read")
        if self.attributes.encoding is not None and (self.data_type != "int32" or not self.attributes.step):
            raise ValueError("an encoding by differences is of int32 and has a step")
        return self

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of what is stored; differences become float32."""
        return np.dtype(self.data_type)

    @property
    def chunks(self) -> tuple[int, ...]:
        """The shape of a chunk."""
        return tuple(self.chunk_grid.configuration.chunk_shape)

    @property
    def chunk_bytes(self) -> int:
        """A chunk's size before compression."""
        return math.prod(self.chunks) * self.dtype.itemsize

    def chunk_key(self, place: Sequence[int]) -> str:
        """The name of a chunk's file, by its place in the grid of chunks."""
        return self.chunk_key_encoding.configuration.separator.join(["c", *map(str, place)])


def read_root(place: Place, where: str) -> dict[str, Any]:
    """The root attributes of a data set.

    Raises:
        InputError: metadata that are damaged, or of something else than a data set that this program reads.
    """
    (content,) = _contents(place, [METADATA], where)
    attributes = _attributes(content, f"{where}/{METADATA}")
    check_root(attributes, where)
    return attributes | validated(RootAttributes, attributes, f"{where}/{METADATA}").model_dump()


def read_clips(place: Place, names: Sequence[str], where: str) -> list[ClipAttributes]:
    """Attributes of clips, by their names "<garment>/<clip>", fetched together.

    Args:
        where: path or URL of the data set, for messages.

    Raises:
        InputError: metadata that are missing or damaged; the message names the file and the key.
    """
    files = [f"{name}/{METADATA}" for name in names]
    contents = zip(files, _contents(place, files, where), strict=True)
    named = [(f"{where}/{file}", content) for file, content in contents]
    return [validated(ClipAttributes, _attributes(content, name), name) for name, content in named]


def read_arrays(place: Place, folders: Sequence[str], where: str) -> list[ArrayMetadata]:
    """Metadata of arrays, fetched together; see `read_clips`."""
    files = [f"{folder}/{METADATA}" for folder in folders]
    contents = zip(files, _contents(place, files, where), strict=True)
    return [
        validated(ArrayMetadata, parsed(content, f"{where}/{file}"), f"{where}/{file}")
        for file, content in contents
    ]


def parsed(content: bytes, where: str) -> Any:
    """JSON.

    Raises:
        InputError: it is none; the message names `where`.
    """
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where}: not the metadata of a Zarr v3 group or array ({error})") from error


def validated(model: type[Model], values: Any, where: str) -> Model:
    """The values in their schema.

    Raises:
        InputError: they do not fit; the message names `where` and the first key.
    """
    try:
        return model.model_validate(values)
    except UnicodeError as error:  # half of a pair of UTF-16, which JSON can spell
        raise InputError(f"{where}: holds text that is none ({error}); write it again") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        given = "" if first["type"] in ("missing", "value_error") else f", found {str(first['input'])[:80]!r}"
        reason = first["msg"].removeprefix("Value error, ")
        more = f" ({error.error_count()} faults)" if error.error_count() > 1 else ""
        raise InputError(
            f"{where}: {f'{key}: ' if key else ''}{reason}{given}{more}; write it again, or restore it from a copy"
        ) from error


def _contents(place: Place, files: Sequence[str], where: str) -> list[bytes]:
    contents = place.read_many(files)
    for file, content in zip(files, contents, strict=True):
        if content is None:
            raise InputError(f"{where}/{file}: no such file; the store is damaged, restore it from a copy")
    return [content for content in contents if content is not None]


def _attributes(content: bytes, where: str) -> dict[str, Any]:
    group = parsed(content, where)
    attributes = group.get("attributes") if isinstance(group, dict) else None
    if not isinstance(attributes, dict) or group.get("node_type", "group") != "group":
        raise InputError(f"{where}: not the metadata of a Zarr v3 group, as those of {FORMAT} are")
    return attributes
