"""The mouse in a real browser: a mark that follows it over a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page
from viser import ClientHandle

from imgtransfer.viewing import Show, address_of, open_sources, page_server
from imgtransfer.viewing.map_wall import WIDTH
from tests.helpers.browser import chromium, visited
from tests.helpers.viewing import SCENE, put, step_for, step_until, wait_for_scene

_KNOWN = "Unable to preventDefault inside passive event listener invocation."  # viser's, of some mouse clicks


def on_screen(page: Page, client: ClientHandle, point: np.ndarray) -> tuple[float, float]:
    """Where the page shows a point (3,) of the scene, in its pixels."""
    box = page.locator(SCENE).bounding_box()
    assert box is not None
    camera = client.camera
    eye = np.asarray(camera.position)
    forward = np.asarray(camera.look_at) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up_direction)
    right /= np.linalg.norm(right)
    depth = (point - eye) @ forward
    focal = box["height"] / 2 / np.tan(camera.fov / 2) / depth
    across, down = (point - eye) @ right * focal, -((point - eye) @ np.cross(right, forward)) * focal
    return box["x"] + box["width"] / 2 + float(across), box["y"] + box["height"] / 2 + float(down)


@pytest.mark.long
def test_a_mark_follows_the_mouse_that_is_dragged_over_a_map(data: Path) -> None:
    """It ends on the point of the garment that the pixel under the mouse shows, on the mesh and on the map."""
    with page_server("127.0.0.1", 0) as server, chromium() as browser:
        show = Show(server, open_sources([data], ["*/a"]))
        put(show._look._maps, "normals")
        show.draw()
        with visited(browser, address_of(server), width=800, height=450) as visit:
            page, look = visit.page, show._look
            wait_for_scene(page)
            step_until(show, page, lambda: bool(server.get_clients()))
            step_for(show, page, 3)
            (client,) = server.get_clients().values()
            (figure,) = show._figures
            wall = figure._wall
            size, mask = wall._sizes[0], figure.motion.frame(0).maps().mask[0]  # type: ignore[union-attr]
            rows, columns = np.nonzero(mask)

            def pixel(fraction: float) -> tuple[int, int]:
                row = int(np.quantile(rows, fraction))
                return row, int(np.median(columns[rows == row]))

            def place(row: int, column: int) -> tuple[float, float]:
                right = (column + 0.5) / size[1] - 0.5
                up = (0.5 - (row + 0.5) / size[0]) * size[0] / size[1]
                centre = wall._centre(0, size) + figure._offset
                return on_screen(page, client, centre + WIDTH * np.array([right, up, 0.0]))

            # Of the picture's lower half: the upper one of a tube's is above the window.
            start, end = pixel(0.55), pixel(0.85)
            page.mouse.move(*place(*start))
            step_for(show, page, 1)  # the page looks what is under the mouse when it draws
            page.mouse.down()
            step_for(show, page, 1)
            for way in np.linspace(0, 1, 6)[1:]:
                page.mouse.move(*((1 - way) * np.array(place(*start)) + way * np.array(place(*end))))
                step_for(show, page, 0.3)
            step_until(show, page, lambda: look.mark is not None)
            step_for(show, page, 2)
            page.mouse.up()
            step_for(show, page, 1)
            assert look.mark is not None
            shown = wall._of_template().pixel(0, look.mark)
            assert shown is not None
            # A pixel of the page is some two of the map, and the last move may come to nothing where the button rises.
            assert np.abs(np.subtract(shown, end)).max() <= 4
            vertices = figure.motion.frame(0).garment
            assert vertices is not None
            on_mesh = look.mark.place(vertices, figure.motion.dress.rest.faces)
            assert figure._shown is not None
            np.testing.assert_allclose(figure._ball.position, on_mesh - figure._shown[1], atol=1e-6)
            assert f"pixel {shown[0]}, {shown[1]}" in page.inner_text("body")
            visit.check(known=_KNOWN)
