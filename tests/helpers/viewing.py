"""The page of `imgtransfer view` in a browser, driven step by step or as a command of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from playwright.sync_api import Page

from imgtransfer.viewing import Show
from tests.helpers.paths import ROOT

SCENE = "canvas[data-engine]"  # three.js says so of its canvas
_LONGEST_S = 300.0  # software rendering on a busy machine


def wait_for_scene(page: Page) -> None:
    """Wait until the scene is there."""
    page.wait_for_selector(SCENE, timeout=1000 * _LONGEST_S)


def step_until(show: Show, page: Page, reached: Callable[[], bool]) -> None:
    """Let the page draw until something is so."""
    end = time.monotonic() + _LONGEST_S
    while not reached():
        assert time.monotonic() < end, "the page never came so far"
        show.step()
        page.wait_for_timeout(30)


def step_for(show: Show, page: Page, seconds: float) -> None:
    """Let the page draw for a while."""
    end = time.monotonic() + seconds
    step_until(show, page, lambda: time.monotonic() >= end)


def put(control: object, value: object) -> None:
    """Set one of the page's controls."""
    control.value = value  # type: ignore[attr-defined]


# A test in the background inherits that Ctrl-C is ignored.
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from imgtransfer.cli.main import main
sys.exit(main())
"""


@contextmanager
def running(*words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`imgtransfer view` with these arguments on a free port; yields the process and the page's address."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", PROGRAM, "view", "--port", "0", "--no-browser", *words]
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        found = re.search(r"http://\S+", process.stdout.readline())
        assert found, process.communicate()[1]
        yield process, found[0]
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
