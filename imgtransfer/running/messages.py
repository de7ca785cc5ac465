"""How a program tells its user what the library has to say: options as flags, notes as lines on stderr."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from render.errors import one_line
from render.options import Option

# Where parameter and flag have different names.
_FLAGS = {"clips": "--clip", "changes": "--set", "up_axis": "--set files.up_axis"}
_LAYERS = ("render", "fusion", "imgtransfer")


def as_flag(option: Option) -> str:
    """An option as a command line has it: --weld, --garment-unit=cm."""
    flag = _FLAGS.get(option.name, f"--{option.name.replace('_', '-')}")
    return flag if option.value is None or option.value is True else f"{flag}={option.value}"


@contextmanager
def notes_on_stderr() -> Iterator[None]:
    """In here, what the library logs from level INFO on is a line on stderr each, above the bars that are there."""
    handler, loggers = _Lines(), [logging.getLogger(layer) for layer in _LAYERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)


class _Lines(logging.Handler):
    """Writes to whatever stderr is at the time."""

    def emit(self, record: logging.LogRecord) -> None:
        from tqdm import tqdm  # noqa: PLC0415 (a program that has nothing to say does not wait for it)

        try:
            # Names of joints, files and materials in it may be anybody's.
            shown = "\n".join(map(one_line, self.format(record).splitlines()))
            tqdm.write(shown, file=sys.stderr)
            sys.stderr.flush()
        except Exception:
            self.handleError(record)
