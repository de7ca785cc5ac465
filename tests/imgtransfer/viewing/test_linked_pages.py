"""Pages that are linked look from one place: the others follow the one that somebody moves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import viser

from imgtransfer.viewing import Show, address_of, open_sources, page_server
from tests.helpers.bare_page import BarePage, bare_page, wait_until
from tests.helpers.browser import chromium, visited
from tests.helpers.viewing import SCENE, put, step_for, step_until, wait_for_scene

_KNOWN = "Unable to preventDefault inside passive event listener invocation."  # viser's, of some mouse clicks
_FRONT, _SIDE, _BACK = (0.0, 1.0, 3.0), (3.0, 1.0, 0.0), (0.0, 1.5, -3.0)
_WHILE_S = 0.3  # in which something would happen, if it did


@pytest.fixture
def shown() -> Iterator[tuple[viser.ViserServer, Show]]:
    with page_server("127.0.0.1", 0) as server:
        yield server, Show(server, {})


@contextmanager
def two_pages(server: viser.ViserServer) -> Iterator[tuple[BarePage, BarePage]]:
    with bare_page(server, _FRONT) as one, bare_page(server, _FRONT) as other:
        yield one, other


def follows(page: BarePage, eye: tuple[float, float, float]) -> None:
    """Wait until a page has been told to look from a place at what the other looks at."""
    wait_until(lambda: "position" in page.told and bool(np.allclose(page.told["position"], eye)))
    wait_until(lambda: bool(np.allclose(page.told["look_at"], (0, 1, 0))))


def test_a_linked_page_follows_and_another_does_not(shown: tuple[viser.ViserServer, Show]) -> None:
    server, show = shown
    with two_pages(server) as (one, other):
        one.look(_SIDE)
        time.sleep(_WHILE_S)
        assert not other.told
        put(show._look.linked, True)
        one.look(_BACK)
        follows(other, _BACK)
        assert not one.told
        other.look(_BACK)  # it has done so
        other.look(_SIDE)
        follows(one, _SIDE)


def test_a_page_that_is_slow_to_follow_does_not_pull_the_other_back(
    shown: tuple[viser.ViserServer, Show],
) -> None:
    """Where there is no GPU, a page reports for seconds where it was told to look from before."""
    server, show = shown
    put(show._look.linked, True)
    with two_pages(server) as (one, other):
        one.look(_SIDE)
        follows(other, _SIDE)
        one.look(_BACK)
        follows(other, _BACK)
        time.sleep(0.6)
        other.look(_SIDE)
        other.look(
            (0.5, 1.2, -2.0), (0.0, 0.7, 0.0)
        )  # it has the eye's new place, and not yet what to look at
        other.look(_BACK)
        time.sleep(_WHILE_S)
        assert not one.told
        other.look(_FRONT)  # now somebody moves it
        follows(one, _FRONT)


def test_a_page_that_is_opened_later_looks_from_where_linked_ones_do(
    shown: tuple[viser.ViserServer, Show],
) -> None:
    server, show = shown
    put(show._look.linked, True)
    with bare_page(server, _SIDE) as one, bare_page(server, _FRONT) as other:
        follows(other, _SIDE)
        other.look(_FRONT)  # what it looked from before it was told
        time.sleep(_WHILE_S)
        assert not one.told


def test_the_page_on_which_pages_are_linked_leads(shown: tuple[viser.ViserServer, Show]) -> None:
    server, show = shown
    with bare_page(server, _SIDE) as one, bare_page(server, _FRONT) as other:
        other.set(show._look.linked, True)
        follows(one, _FRONT)
        assert not other.told


@pytest.mark.long
def test_a_page_in_a_browser_leads_and_follows(data: Path) -> None:
    """What it looks from is what it reports itself."""
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, open_sources([data], ["*/a"]))
        put(show._look.linked, True)
        show.draw()
        with visited(browser, address_of(server), width=480, height=300) as visit:
            wait_for_scene(visit.page)
            step_until(show, visit.page, lambda: bool(server.get_clients()))
            step_for(show, visit.page, 2)
            (client,) = server.get_clients().values()
            reported: list[np.ndarray] = []
            client.camera.on_update(lambda camera: reported.append(np.array(camera.position)))
            with bare_page(server, tuple(client.camera.position)) as other:
                other.look(tuple(client.camera.position), tuple(client.camera.look_at))
                box = visit.page.locator(SCENE).bounding_box()
                assert box is not None
                x, y = box["x"] + box["width"] / 3, box["y"] + box["height"] / 2
                visit.page.mouse.move(x, y)
                visit.page.mouse.down()
                visit.page.mouse.move(x + 60, y)
                visit.page.mouse.up()
                step_until(
                    show,
                    visit.page,
                    lambda: (
                        len(reported) > 0
                        and "position" in other.told
                        and np.allclose(other.told["position"], reported[-1], atol=0.02)
                    ),
                )
                assert abs(reported[-1][0]) > 0.2  # metres to the side, from the front
                other.look(tuple(other.told["position"]), tuple(other.told["look_at"]))
                other.look(_BACK)
                step_until(show, visit.page, lambda: np.allclose(reported[-1], _BACK, atol=0.02))
            visit.check(known=_KNOWN)
