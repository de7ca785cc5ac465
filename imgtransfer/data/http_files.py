"""Files of a web server, which may send what it likes: sizes and waiting are limited, and a refusal is no absence."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import aiohttp
from fsspec.implementations.http import HTTPFileSystem  # type: ignore[import-untyped]

from imgtransfer.data.place import METADATA_LIMIT

PATIENCE = 30.0  # seconds without an answer, and after which an answer must have come at SLOWEST
SLOWEST = 1 << 14  # bytes a second
_LARGEST_FILE = (1 << 31) + (1 << 26)  # bytes; of a chunk, where nothing else is known
_PIECE = 1 << 16


class TooMuchError(OSError):
    """The server sends more than was asked for."""


class WholeFilesError(OSError):
    """The server does not answer requests for a part of a file."""


class _Response(aiohttp.ClientResponse):
    """An answer that is read up to a limit, and not for ever; every way of reading whole answers leads through it."""

    limit = METADATA_LIMIT  # as listings have it

    async def read(self) -> bytes:
        if self._body is None:
            started, parts, size = time.monotonic(), [], 0
            async for part in self.content.iter_chunked(_PIECE):
                parts.append(part)
                size += len(part)
                if size > self.limit:
                    self.close()
                    raise TooMuchError(f"the server sends more than {self.limit} bytes")
                waited = time.monotonic() - started
                if waited > PATIENCE and size < SLOWEST * waited:
                    self.close()
                    raise TimeoutError(f"the server sent {size} bytes in {waited:.0f} s")
            self._body = b"".join(parts)
        return self._body


async def _session(**options: Any) -> aiohttp.ClientSession:
    patience = aiohttp.ClientTimeout(total=None, connect=PATIENCE, sock_connect=PATIENCE, sock_read=PATIENCE)
    return aiohttp.ClientSession(response_class=_Response, **{**options, "timeout": patience})


class HttpFiles(HTTPFileSystem):
    """fsspec's web server, for reading, with limits.

    Every method may raise TimeoutError, TooMuchError, WholeFilesError, an `aiohttp.ClientError` for what the server
    answers, and FileNotFoundError for 404 and 410 alone.
    """

    cachable = False  # the time-outs of a session are those of its making

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{**options, "get_client": _session})

    def _raise_not_found_for_status(self, response: aiohttp.ClientResponse, url: str) -> None:
        if response.status in (404, 410):
            raise FileNotFoundError(url)
        response.raise_for_status()

    async def _cat_file(
        self, url: str, start: int | None = None, end: int | None = None, limit: int = _LARGEST_FILE, **_: Any
    ) -> bytes:
        session = await self.set_session()
        options, part = dict(self.kwargs), start is not None and end is not None
        if start is not None and end is not None:
            limit = end - start
            asked = {"Range": f"bytes={start}-{end - 1}", "Accept-Encoding": "identity"}
            options["headers"] = {**options.get("headers", {}), **asked}
        async with session.get(self.encode_url(url), **options) as response:
            self._raise_not_found_for_status(response, url)
            if part and response.status != 206:
                raise WholeFilesError(
                    "the server sends no parts of files; put simplecache:: before the URL, which copies the file here"
                )
            response.limit = limit
            content = await response.read()
        return content if part else content[start:end]

    async def _get_file(self, rpath: str, lpath: str, **_: Any) -> None:
        """Copy a file here, as chains such as simplecache:: do."""
        Path(lpath).write_bytes(await self._cat_file(rpath))

    async def _exists(self, path: str, **_: Any) -> bool:
        session = await self.set_session()
        async with session.get(self.encode_url(path), **self.kwargs) as response:
            try:
                self._raise_not_found_for_status(response, path)
            except FileNotFoundError:
                return False
            return True

    async def _isfile(self, path: str, **_: Any) -> bool:
        return await self._exists(path)


def reason(error: Exception) -> str:
    """What went wrong, in one line of plain words."""
    if isinstance(error, aiohttp.TooManyRedirects):
        return "the server redirects in a circle"
    if isinstance(error, aiohttp.ClientResponseError):
        return f"the server answers {error.status} {error.message}"
    if isinstance(error, TimeoutError) and not (str(error) and error.args):
        return f"no answer within {PATIENCE:g} s"
    if isinstance(error, aiohttp.ServerTimeoutError):
        return f"no answer within {PATIENCE:g} s"
    return " ".join(str(error).split()) or type(error).__name__
