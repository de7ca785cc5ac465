"""A real Chromium, and what a page did in it: what its console said, and which requests left for other hosts."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from playwright.sync_api import Browser, ConsoleMessage, Page, Request, Route, sync_playwright

_NAMES = ("chromium", "chromium-browser", "google-chrome")
# The GL that Chromium brings along, for WebGL on machines without a GPU; no sandbox, for containers.
_ARGUMENTS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_LONGEST_MS = 300_000  # on a busy machine without a GPU
_OWN_HOSTS = ("127.0.0.1", "localhost", "")  # the empty one of file:, data: and blob:


@dataclass(eq=False)
class Visit:
    """A page, with what it has done since it was opened.

    Args:
        page: playwright's.
        errors: what its console called an error, and exceptions that nothing caught.
        elsewhere: addresses on other hosts that it asked for; none of these requests was let through.
    """

    page: Page
    errors: list[str] = field(default_factory=list)
    elsewhere: list[str] = field(default_factory=list)

    def check(self, known: str = "") -> None:
        """Fail where the console had another error than `known`, or anything was asked of another host."""
        assert not self.elsewhere, f"requests to other hosts: {self.elsewhere}"
        assert set(self.errors) <= {known}, f"errors in the console: {self.errors}"


@contextmanager
def chromium() -> Iterator[Browser]:
    """A Chromium of this machine without a window; `scripts/test` installs one."""
    found = next((path for path in map(shutil.which, _NAMES) if path), None)
    assert found is not None, f"none of {', '.join(_NAMES)} is there"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=list(_ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def visited(
    browser: Browser,
    address: str,
    *,
    width: int = 1280,
    height: int = 800,
    dark: bool = False,
) -> Iterator[Visit]:
    """Open an address (http: of this machine, or file:) in a window of its own, `width` × `height` pixels."""
    context = browser.new_context(
        viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light"
    )
    context.set_default_timeout(_LONGEST_MS)
    page = context.new_page()
    visit = Visit(page)

    def note(message: ConsoleMessage) -> None:
        if message.type == "error":
            visit.errors.append(message.text)

    def refuse(route: Route, request: Request) -> None:
        if (urlsplit(request.url).hostname or "") in _OWN_HOSTS:
            route.continue_()
        else:
            visit.elsewhere.append(request.url)
            route.abort()

    page.on("console", note)
    page.on("pageerror", lambda error: visit.errors.append(str(error)))
    context.route("**/*", refuse)
    page.goto(address)
    try:
        yield visit
    finally:
        context.close()
