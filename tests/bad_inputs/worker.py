"""A process that runs bad inputs one after the other, each in its own folder; started by the supervisor.

Reads a line `NAME FOLDER` from stdin, answers with a line of JSON: status, out, err, peak (bytes of memory).
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import resource
import signal
import sys
import traceback
from pathlib import Path
from typing import Any, TextIO

from imgtransfer.cli.main import main
from tests.bad_inputs.case import Case
from tests.bad_inputs.cases import cases


def run(case: Case, folder: Path) -> dict[str, Any]:
    """Run the case's command in `folder`, where its input is."""
    os.chdir(folder)
    _forget_peak()
    with (folder.parent / "out.txt").open("w+") as out, (folder.parent / "err.txt").open("w+") as err:
        with _redirected(out, err):
            faulthandler.register(signal.SIGUSR1, file=err)  # the supervisor asks where it hangs
            status = _status(case)
            faulthandler.unregister(signal.SIGUSR1)
        answer = {"status": status, "peak": _peak()}
        for name, file in (("out", out), ("err", err)):
            file.seek(0)
            answer[name] = file.buffer.read().decode(errors="replace")
    os.chdir("/")
    return answer


def _status(case: Case) -> int:
    try:
        return main(list(case.argv))
    except SystemExit as stop:  # argparse
        return stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
        return 1


@contextlib.contextmanager
def _redirected(out: TextIO, err: TextIO) -> Any:
    """The process's own stdout and stderr, those of libraries in C too, into files."""
    kept = [os.dup(1), os.dup(2)]
    before = sys.stdout, sys.stderr
    os.dup2(out.fileno(), 1)
    os.dup2(err.fileno(), 2)
    sys.stdout, sys.stderr = (
        os.fdopen(os.dup(number), "w", encoding="utf-8", errors=errors)
        for number, errors in ((1, "strict"), (2, "backslashreplace"))
    )
    try:
        yield
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.close()
        sys.stderr.close()
        sys.stdout, sys.stderr = before
        for number, saved in enumerate(kept, 1):
            os.dup2(saved, number)
            os.close(saved)


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Most memory since `_forget_peak`, bytes; since the start of the process where Linux is not to be had."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def serve() -> None:
    """Answer lines from stdin until it ends."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)  # what libraries print on their own is no answer
    for line in sys.stdin:
        name, _, folder = line.rstrip("\n").partition(" ")
        answers.write(json.dumps(run(cases()[name], Path(folder))) + "\n")


if __name__ == "__main__":
    serve()
