"""The text of `imgtransfer doctor --report`: the machine and the packages, for a bug report, without the user."""

from __future__ import annotations

import getpass
import os
import platform
import re
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from imgtransfer.cli.machine import Part, cores

PROJECT = "imgtransfer"
# The only variables that are shown: they change what is computed or how fast, and hold no secrets.
VARIABLES = (
    "CUBLAS_WORKSPACE_CONFIG",
    "CUDA_VISIBLE_DEVICES",
    "LP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OMP_WAIT_POLICY",
    "OPENBLAS_NUM_THREADS",
    "WORLD_SIZE",
)


def bug_report(parts: Sequence[Part]) -> str:
    """Markdown to paste.

    Args:
        parts: what `doctor.examined` found.

    Returns:
        Tables of the machine and of the extras, what does not work, and the version of every package that the project
        names; nothing in it tells who the user is (`scrubbed`).
    """
    problems = [part.problem for part in parts if part.problem]
    packages = {package: _version(package) for needed in _requirements().values() for package in needed}
    text = [
        "### Machine",
        "",
        *_table([*_machine(), *(line for part in parts for line in part.lines if line[0] != "versions")]),
        "",
        "### What does not work",
        "",
        *(
            [f"- {_one_cell(problem)}" for problem in problems]
            or ["Nothing that `imgtransfer doctor` looks at."]
        ),
        "",
        "### Extras",
        "",
        *_table((extra, _state(needed)) for extra, needed in sorted(_requirements().items()) if extra),
        "",
        "### Packages",
        "",
        "```",
        *(f"{name}=={found}" for name, found in sorted(packages.items()) if found is not None),
        "```",
        "",
    ]
    return scrubbed("\n".join(text))


def scrubbed(text: str) -> str:
    """The text with `~` in place of the home folder, and USER in place of the user's name in other paths."""
    for home in {str(Path.home()), str(Path.home().resolve())} - {"/"}:
        text = re.sub(rf"{re.escape(home)}(?![\w.-])", "~", text)
    return re.sub(rf"(?<=[/\\]){re.escape(_user())}(?![\w.-])", "USER", text)


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a container's user that has no name
        return "USER"


def _machine() -> Iterator[tuple[str, str]]:
    yield PROJECT, f"{_version(PROJECT) or 'not installed'} in {Path(__file__).resolve().parents[2]}"
    yield "system", f"{platform.system()} {platform.release()}, {platform.machine()}"
    yield "memory", _memory()
    yield "cores", str(cores())
    chosen = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
    yield "variables", ", ".join(chosen) or "none that matter"


def _memory() -> str:
    try:
        return f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.1f} GiB"
    except (AttributeError, ValueError, OSError):  # not on every system
        return "unknown"


def _requirements() -> dict[str, list[str]]:
    """Names of the packages that the project needs ("") and that each extra brings."""
    needed: dict[str, list[str]] = {"": [PROJECT]}
    for line in _declared():
        name = re.match(r"[\w.-]+", line)
        extra = re.search(r"""extra == ["']([\w.-]+)["']""", line)
        if name is not None:
            needed.setdefault(extra.group(1) if extra else "", []).append(name.group())
    return needed


def _declared() -> list[str]:
    try:
        return requires(PROJECT) or []
    except PackageNotFoundError:  # run from its folder without being installed
        return []


def _state(packages: Iterable[str]) -> str:
    absent = sorted({package for package in packages if _version(package) is None})
    return f"missing: {', '.join(absent)}" if absent else "present"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _table(rows: Iterable[tuple[str, str]]) -> list[str]:
    return [
        "| what | found |",
        "| --- | --- |",
        *(f"| {name} | {_one_cell(value)} |" for name, value in rows),
    ]


def _one_cell(text: str) -> str:
    """Text that neither ends a cell nor a line."""
    return " ".join(text.split()).replace("|", "\\|")
