"""The page in a real browser: it loads, plays, marks and ends, and asks nothing of other hosts."""

from __future__ import annotations

import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Page

from imgtransfer.cli.main import main
from imgtransfer.shipped import shipped_model
from imgtransfer.viewing import LiveControls, Show, address_of, open_sources, page_server
from tests.helpers.browser import Visit, chromium, visited
from tests.helpers.paths import ROOT
from tests.helpers.viewing import put, running, step_until, wait_for_scene

_LONGEST_MS = 300_000  # software rendering on a busy machine takes long
INPUTS = "[...document.querySelectorAll('input')].map(input => input.value).join()"


def picture(page: Page) -> np.ndarray:
    """(H, W, 3) uint8, of what is to be seen."""
    shot = np.frombuffer(page.screenshot(timeout=_LONGEST_MS), np.uint8)
    decoded: np.ndarray = cv2.imdecode(shot, cv2.IMREAD_COLOR)
    return decoded[..., ::-1]


def reddish(image: np.ndarray) -> int:
    """How many pixels of the scene are of colours that neither cloth nor skin has, but maps of normals do."""
    red, green, blue = np.moveaxis(image[:, : image.shape[1] // 2].astype(int), -1, 0)
    return int(((red - green > 60) & (blue > 80)).sum())


def says(page: Page, text: str) -> bool:
    """Whether the page shows a text."""
    return text in page.inner_text("body")


def coloured(image: np.ndarray) -> int:
    """How many pixels of the scene, left of the controls, have a colour of their own."""
    scene = image[:, : image.shape[1] // 2].astype(int)
    return int((scene.max(axis=-1) - scene.min(axis=-1) > 20).sum())


def test_the_command_serves_a_page_that_plays_and_ctrl_c_ends_it(data: Path) -> None:
    with running(str(data), "--clip", "*/a") as (process, address):
        with chromium() as browser, visited(browser, address, width=480, height=300) as visit:
            page = visit.page
            wait_for_scene(page)
            before = page.evaluate(INPUTS)
            page.get_by_role("button", name="play").click(timeout=_LONGEST_MS)
            page.wait_for_function(f"{INPUTS} !== {before!r}", timeout=_LONGEST_MS)
            visit.check()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=_LONGEST_MS / 1000)
    assert process.returncode == 130
    assert said == "imgtransfer: stopped\n"


@pytest.fixture
def page_of(data: Path, predictions: Path) -> Iterator[tuple[Show, Visit]]:
    """The truth and a prediction side by side, drawn and opened."""
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, open_sources([data, predictions]))
        show.draw()
        with visited(browser, address_of(server), width=1000, height=500) as visit:
            wait_for_scene(visit.page)
            step_until(show, visit.page, lambda: coloured(picture(visit.page)) > 500)
            yield show, visit
            # viser's camera controls say so of some mouse clicks.
            visit.check(known="Unable to preventDefault inside passive event listener invocation.")


@pytest.mark.long
def test_colours_maps_and_marks_are_seen(page_of: tuple[Show, Visit]) -> None:
    show, visit = page_of
    look = show._look
    before = reddish(picture(visit.page))
    put(look._colours, "error")
    put(look._maps, "normals")
    put(look._crossings, True)
    step_until(show, visit.page, lambda: says(visit.page, "mean 20.0 mm"))  # the fused vertices are 20 mm off
    assert says(visit.page, "edges through the other")
    # The maps are beside them.
    step_until(show, visit.page, lambda: reddish(picture(visit.page)) > before + 300)
    shown = picture(visit.page)
    middle = shown.shape[1] // 2
    saturated = (shown.max(-1).astype(int) - shown.min(-1) > 60)[:, :middle]
    rows, columns = np.nonzero(saturated)
    nearest = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
    visit.page.mouse.click(int(columns[nearest]), int(rows[nearest]))
    step_until(show, visit.page, lambda: look.mark is not None)
    step_until(show, visit.page, lambda: says(visit.page, "mark at"))
    assert says(visit.page, "pixel")


@pytest.mark.long
def test_another_clip_takes_the_place_of_the_first(page_of: tuple[Show, Visit]) -> None:
    show, visit = page_of
    assert show._clip is not None
    put(show._clip._clip, "tube/b")
    step_until(show, visit.page, lambda: says(visit.page, "method, position only"))
    assert not says(visit.page, "method, fused")


@pytest.mark.long
def test_a_closed_page_is_missed_by_nobody_and_opens_again(data: Path) -> None:
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, open_sources([data]))
        show.draw()
        assert show._play is not None
        for _ in range(2):
            with visited(browser, address_of(server), width=700, height=400) as visit:
                wait_for_scene(visit.page)
                step_until(show, visit.page, lambda: len(server.get_clients()) == 1)
                show._play._set_playing(True)
                before = show._clock.frame()
                step_until(show, visit.page, lambda before=before: show._clock.frame() != before)  # type: ignore[misc]
                visit.check()
            while server.get_clients():
                show.step()
            show.step()
            frame = show._clock.frame()
            show.step()
            assert show._clock.frame() == frame  # nothing plays for nobody


@pytest.mark.long
def test_a_damaged_frame_is_said_on_the_page_which_stays(data: Path) -> None:
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, open_sources([data]))
        show.draw()
        with visited(browser, address_of(server), width=700, height=500) as visit:
            wait_for_scene(visit.page)
            assert show._clip is not None
            for chunk in (data / "tube/b/garment_vertices").rglob("c/*/*/*"):
                chunk.write_bytes(b"damaged")
            put(show._clip._clip, "tube/b")
            step_until(show, visit.page, lambda: says(visit.page, "the store is damaged"))
            put(show._clip._clip, "tube/a")
            step_until(show, visit.page, lambda: not says(visit.page, "damaged"))
            visit.check()


@pytest.mark.long
def test_a_garment_is_predicted_live() -> None:
    model = shipped_model("general")
    assert model is not None
    live = LiveControls(model, on=True)
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, {}, live)
        show.draw()
        with visited(browser, address_of(server), width=1000, height=500) as visit:
            wait_for_scene(visit.page)
            step_until(show, visit.page, lambda: coloured(picture(visit.page)) > 500)
            before, first = picture(visit.page), live.motion()
            assert first is not None
            put(live._turns["arms up"], 40)
            step_until(
                show, visit.page, lambda: bool((picture(visit.page)[:, :500] != before[:, :500]).any())
            )
            put(live._shape["weight"], 0.9)
            show.step()
            last = live.motion()
            assert last is not None
            assert np.ptp(last.now.body[:, 2]) > np.ptp(first.now.body[:, 2])  # stouter
            assert " ms" in str(live._took.value)
            visit.check()


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """The line that the command says before it ends with status 2."""
    capsys.readouterr()
    assert main(["view", *map(str, words)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def test_a_port_in_use_is_named(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        said = refused(capsys, data, "--no-browser", "--port", port)
    assert f"--port {port}: is in use on 127.0.0.1" in said


def test_a_host_that_is_not_this_machines_is_refused(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--host 192.0.2.1: is not an address of this machine" in refused(
        capsys, data, "--no-browser", "--port", 0, "--host", "192.0.2.1"
    )
    assert "no such host" in refused(capsys, data, "--no-browser", "--host", "no host", "--port", 0)


def test_a_page_for_everybody_says_that_it_has_no_password(caplog: pytest.LogCaptureFixture) -> None:
    with page_server("0.0.0.0", 0) as server:
        assert address_of(server).startswith("http://127.0.0.1:")
    assert "there is no password" in caplog.text
    caplog.clear()
    with page_server("127.0.0.1", 0):
        pass
    assert not caplog.text


def test_nobody_puts_the_page_on_the_internet() -> None:
    with page_server("127.0.0.1", 0) as server:
        assert server.request_share_url() is None
        assert server._share_tunnel is None


def test_a_model_of_one_garment_cannot_dress_any(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, data, "--no-browser", "--port", 0, "--model", ROOT / "configs" / "pretrained")
    assert "is for one garment" in said
