"""The page's controls: what is shown, how, and when."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from imgtransfer.pipeline.folder import METHODS
from imgtransfer.viewing.colours import UNITS, Colours
from imgtransfer.viewing.figure import Facts
from imgtransfer.viewing.look import COLOURS, MAPS, Look, Maps
from imgtransfer.viewing.picking import Mark
from imgtransfer.viewing.sources import Showing
from render.pictures import png_bytes, scale_bar

if TYPE_CHECKING:  # a package of an extra
    from viser import GuiApi

_BAR_WIDTH = 260  # pixels
_RATES = 0.1, 240.0  # frames a second
BOTH = "both"


def when_changed(handle: Any, call: Callable[[], None]) -> None:
    """Call where a person changes a control, and not where the program does."""

    @handle.on_update
    def _(event: Any) -> None:
        if event.client is not None:
            call()


def put(handle: Any, value: Any) -> None:
    """Give a control a value; type checkers do not see that viser's may be assigned to."""
    handle.value = value


class ClipControls:
    """Which clip, and which of what was predicted for it.

    Args:
        gui: of the page. clips: what there is of each. changed: called where a person changes something.
    """

    def __init__(
        self, gui: GuiApi, clips: dict[str, tuple[Showing, ...]], changed: Callable[[], None]
    ) -> None:
        self._clips = clips
        methods = {showing.method for showings in clips.values() for showing in showings}
        with gui.add_folder("Clip"):
            self._clip = gui.add_dropdown("clip", tuple(clips), initial_value=next(iter(clips)))
            self._method = gui.add_dropdown(
                "predictions",
                (*METHODS, BOTH),
                initial_value=METHODS[0],
                visible=methods >= set(METHODS),
                hint="which vertices of a prediction: fused, or read from the position maps alone",
            )
        for handle in (self._clip, self._method):
            when_changed(handle, changed)

    @property
    def showings(self) -> tuple[Showing, ...]:
        """What is to be shown side by side; of a prediction without the vertices that are asked for, what there is."""
        showings = self._clips[self._clip.value]
        if self._method.value == BOTH:
            return showings
        chosen: dict[object, Showing] = {}
        for number, showing in enumerate(showings):
            key = number if showing.method is None else showing.maps or showing.ref.source
            if key not in chosen or showing.method == self._method.value:
                chosen[key] = showing
        return tuple(chosen.values())


class PlayControls:
    """When: the frame, whether it moves on, and how fast.

    Args:
        gui: of the page.
        moved: called with the frame that a person goes to.
        changed: called where a person plays, pauses or sets the rate.
    """

    def __init__(self, gui: GuiApi, moved: Callable[[int], None], changed: Callable[[], None]) -> None:
        self.playing = False
        with gui.add_folder("Time"):
            self._frame = gui.add_slider("frame", 0, 1, 1, 0)
            self._play = gui.add_button("play")
            self._steps = gui.add_button_group("step", ("back", "forward"))
            self._rate = gui.add_number("frames/s", 30.0, min=_RATES[0], max=_RATES[1], step=0.1)
        when_changed(self._frame, lambda: moved(int(self._frame.value)))
        when_changed(self._rate, changed)

        @self._play.on_click
        def _(_: Any) -> None:
            self._set_playing(not self.playing)
            changed()

        @self._steps.on_click
        def _(_: Any) -> None:
            step = 1 if self._steps.value == "forward" else -1
            moved(int(self._frame.value) + step)

    @property
    def rate(self) -> float:
        """Frames a second."""
        return float(np.clip(self._rate.value, *_RATES))

    def pause(self) -> None:
        """Stay where it is."""
        self._set_playing(False)

    def _set_playing(self, playing: bool) -> None:
        self.playing = playing
        self._play.label = "pause" if playing else "play"

    def set_clip(self, n_frames: int, fps: float) -> None:
        """Take on a clip's length and rate."""
        put(self._frame, 0)
        self._frame.max = max(n_frames - 1, 1)
        self._frame.disabled = n_frames < 2
        put(self._rate, float(np.clip(fps, *_RATES)))

    def show_frame(self, frame: int) -> None:
        """Move the slider."""
        put(self._frame, frame)


class LookControls:
    """How: colours with their bar, marks, maps.

    Args:
        gui: of the page. changed: called where a person changes something.
    """

    def __init__(self, gui: GuiApi, changed: Callable[[], None]) -> None:
        with gui.add_folder("Look"):
            self._colours = gui.add_dropdown(
                "colours",
                COLOURS,
                initial_value="cloth",
                hint="error: distance to the same clip of the first source that is no prediction",
            )
            self._limit = gui.add_number("scale to", 1.0, min=1e-3, step=0.1, visible=False)
            self._bar = gui.add_html("", visible=False)
            self._crossings = gui.add_checkbox(
                "crossing edges",
                False,
                hint="red: edges of the garment or the body that pass through the other; orange: through itself",
            )
            self._maps = gui.add_dropdown(
                "maps",
                MAPS,
                initial_value="none",
                hint="click on a garment or a map to mark a point on both",
            )
            self._in_place = gui.add_checkbox("keep in place", True, hint="take out the way over the floor")
            self.linked = gui.add_checkbox(
                "link pages", False, hint="pages that are open at the same time look from the same place"
            )
            self._unmark = gui.add_button("remove the mark", visible=False)
        self._facts = gui.add_html("")
        self.mark: Mark | None = None
        self.scaled: Colours = "cloth"  # what the scale was chosen for
        for handle in (self._colours, self._limit, self._crossings, self._maps, self._in_place):
            when_changed(handle, changed)

        @self._unmark.on_click
        def _(_: Any) -> None:
            self.mark = None
            changed()

    @property
    def look(self) -> Look:
        """What is asked for."""
        colours: Colours = self._colours.value
        maps: Maps = self._maps.value
        return Look(
            colours=colours,
            limit=max(float(self._limit.value), 1e-6),
            crossings=bool(self._crossings.value),
            maps=maps,
            in_place=bool(self._in_place.value),
            mark=self.mark,
        )

    def set_scale(self, colours: Colours, limit: float) -> None:
        """Choose what the last colour stands for, where the colours are new."""
        self.scaled = colours
        put(self._limit, limit)
        self._limit.label = f"scale to {UNITS[colours]}" if colours in UNITS else "scale to"

    def show(self, look: Look, facts: Sequence[Facts], note: str) -> None:
        """Show the bar of the scale, and what is said of the frame."""
        scaled = look.colours in UNITS
        if scaled:
            self._bar.content = _bar(look.limit, UNITS[look.colours])
        self._bar.visible = self._limit.visible = scaled
        self._unmark.visible = look.mark is not None
        self._facts.content = _text(facts, note)


@lru_cache(maxsize=1)
def _bar(limit: float, unit: str) -> str:
    """The scale as HTML; viser's own pictures may be gone before a busy browser has loaded them, which it logs."""
    png = base64.b64encode(png_bytes(scale_bar(_BAR_WIDTH, limit, unit))).decode()
    text = f"colours from 0 to {limit:g} {unit}"
    return f"<img alt='{text}' style='display:block;margin:auto' src='data:image/png;base64,{png}'>"


def _text(facts: Sequence[Facts], note: str) -> str:
    """Facts as HTML; names in them may be anybody's."""
    lines = [f"<p style='color:#c00'>{html.escape(note)}</p>"] if note else []
    for fact in facts:
        said = [f"<b>{html.escape(fact.title)}</b>"]
        if fact.mean is not None:
            said.append(f"mean {fact.mean[0]:.1f} {fact.mean[1]}")
        if fact.crossings is not None:
            said.append(f"{fact.crossings[0]} edges through the other, {fact.crossings[1]} through itself")
        if fact.place is not None:
            said.append("mark at " + ", ".join(f"{value:.3f}" for value in fact.place) + " m")
        if fact.error is not None:
            said.append(f"{fact.error:.1f} mm off there")
        said += [f"{html.escape(view)} pixel {row}, {column}" for view, row, column in fact.pixels]
        lines.append("<br>".join(said))
    style = "font-size:0.8em;line-height:1.35;padding:0.4em 0.9em;overflow-wrap:anywhere"
    return f"<div style='{style}'>{'<hr>'.join(lines)}</div>"
