"""Whether a command answered a bad input as it must."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from imgtransfer.data.store import DataSet
from render import InputError
from tests.bad_inputs.case import CONTENT, Case
from tests.bad_inputs.supervisor import MEMORY, Answer

_ERROR = re.compile(r"imgtransfer( [a-z]+)?: error: ")
_CLASS = re.compile(r"\b[A-Z][a-zA-Z]*(Error|Exception|Warning)\b")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
_NOTE = re.compile(r"\S+\.py:\d+: \w*Warning: ")
LONGEST = 1500  # characters of a message


def faults(case: Case, answer: Answer) -> list[str]:
    """What is wrong with the answer, each in a line; nothing if it is as it must be."""
    found = []
    if answer.status is None:
        found.append(f"{answer.err.rstrip().splitlines()[-1]} {_place(answer.err)}")
    if "Traceback (most recent call last)" in answer.err + answer.out:
        found.append(f"traceback: {answer.err.rstrip().splitlines()[-1][:300]} {_place(answer.err)}")
    elif answer.status not in (None, 0, 2):
        found.append(f"exit status {answer.status}")
    if answer.peak > MEMORY:
        found.append(f"{answer.peak / 2**30:.1f} GiB of memory")
    if answer.status == 2:
        found += _message_faults(case, answer.err)
    if answer.status == 0 and not case.harmless:
        found.append("accepted")
    if _NOTE.search(answer.err):
        found.append("warning: " + next(line for line in answer.err.splitlines() if _NOTE.search(line))[:200])
    if _CONTROL.search(answer.out) or _CONTROL.search(answer.err.replace("\r", "")):
        found.append("control codes reach the terminal")
    return found + _left_faults(case, answer)


def _place(err: str) -> str:
    """Where in the project a traceback, or the dump of a process that hung, was last."""
    frames = re.findall(r'File "[^"]*?/((?:imgtransfer|fusion|render)/[\w/]+\.py)", line (\d+)', err)
    hung = "ended: " in err  # such a dump begins with the innermost frame
    return "at {}:{}".format(*frames[0 if hung else -1]) if frames else ""


def _message_faults(case: Case, err: str) -> list[str]:
    lines = err.splitlines()
    if not lines or not _ERROR.match(lines[-1]):
        return [f"the last line of stderr is no message: {(lines or [''])[-1][:300]}"]
    found, last = [], lines[-1]
    if sum(bool(_ERROR.match(line)) for line in lines) > 1:
        found.append("several messages")
    if not any(name in last for name in case.named):
        found.append(f"the message names none of {', '.join(case.named)}: {last[:300]}")
    if _CLASS.search(last):
        found.append(f"an exception's class in the message: {last[:300]}")
    if len(last) > LONGEST:
        found.append(f"a message of {len(last)} characters")
    return found


def _left_faults(case: Case, answer: Answer) -> list[str]:
    """Files written elsewhere, left half-written, or full of numbers that are not finite."""
    found = []
    allowed = tuple(f"a/b/{name}" for name in case.writes)
    for path in sorted({*answer.before, *answer.after}):
        if answer.before.get(path) == answer.after.get(path) or path in ("a/out.txt", "a/err.txt"):
            continue
        if path.startswith(allowed):
            if path not in answer.before and any(part.startswith(".") for part in Path(path).parts):
                found.append(f"left behind: {path}")
        else:
            found.append(f"written outside of the output: {path}")
    out = answer.folder / "out"
    written = [path for path in answer.after if path.startswith("a/b/out/")] if "out" in case.writes else []
    others = "set" in case.argv or (out / "zarr.json").exists()  # the results of clips that are good
    if answer.status != 0 and written and not others and "--html" not in case.argv:
        found.append(f"half-written output: {written[0]}")
    if answer.status in (0, 2) and out.is_dir():
        found += [text for path in sorted(out.rglob("*")) for text in _content_faults(path)]
        found += _set_faults(out)
    return found


def _content_faults(path: Path) -> list[str]:
    if path.is_file() and CONTENT in path.read_bytes():
        return [f"{path.name}: a file from elsewhere was copied"]
    if path.suffix == ".npz":
        with np.load(path) as stored:
            wrong = [
                key
                for key in stored.files
                if stored[key].dtype.kind == "f" and not np.isfinite(stored[key]).all()
            ]
        return [f"{path.name}: {key} is not finite" for key in wrong]
    if path.name.endswith(".json") and path.name != "zarr.json":
        strange: list[str] = []
        json.loads(path.read_text(), parse_constant=strange.append)
        return [f"{path.name}: holds {strange[0]}"] if strange else []
    if path.suffix in (".obj", ".mtl") and re.search(r"\b(nan|inf)\b", path.read_text()):
        return [f"{path.name}: holds numbers that are not finite"]
    return []


def _set_faults(out: Path) -> list[str]:
    """A data set that was written can be read."""
    if not (out / "zarr.json").exists():
        return []
    try:
        data = DataSet.open(out)
        for name in data.names():
            data.read(name)
    except InputError as error:
        return [f"a data set that cannot be read: {error}"]
    return []
