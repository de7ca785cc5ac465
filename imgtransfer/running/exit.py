"""How a program ends: its exit status, and what a user can mend as one line."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from imgtransfer.running.memory import shortage
from imgtransfer.running.messages import as_flag, notes_on_stderr
from imgtransfer.running.stopping import Terminated, sigterm_as_interrupt
from render import InputError
from render.errors import one_line
from render.options import options_named


def exit_status(run: Callable[[], object], *, program: str, stopped: str) -> int:
    """Call `run`, and turn what a user can mend into one line on stderr that starts with `program`; options are flags
    in it, and what the library logs are lines before it.

    Returns:
        0 done, 2 input that the user can mend, or a machine that is too small for it; after saying `stopped`,
        130 for Ctrl-C and 143 for SIGTERM.
    """
    try:
        with sigterm_as_interrupt(), options_named(as_flag), notes_on_stderr():
            run()
    except InputError as error:
        print(f"{program}: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as signal:
        print(f"{program}: {stopped}", file=sys.stderr)
        return 143 if isinstance(signal, Terminated) else 130
    except BrokenPipeError:  # `imgtransfer inspect ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (OSError, ValueError, MemoryError, RuntimeError) as error:
        reason = _of_the_machine(error)
        if reason is None:  # a fault of ours
            raise
        print(f"{program}: error: {reason}", file=sys.stderr)
        return 2
    return 0


def _of_the_machine(error: Exception) -> str | None:
    """What files or memory refused, on one line; None where the error is of another kind."""
    if isinstance(error, OSError):  # no permission, a full disk, a file where a folder is wanted
        return one_line(f"{error.filename or 'files'}: {error.strerror or error}")
    if isinstance(error, ValueError):
        of_a_path = "embedded null" in str(error)
        return "a path holds a null character, which no file's name has" if of_a_path else None
    return shortage(error)
