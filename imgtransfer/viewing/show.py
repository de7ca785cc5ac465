"""The page in motion: draws what its controls ask for, one frame at a time, in the thread that runs it."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from imgtransfer.viewing.cameras import Cameras
from imgtransfer.viewing.clip_motion import motions_of
from imgtransfer.viewing.clock import Clock
from imgtransfer.viewing.colours import UNITS, round_limit
from imgtransfer.viewing.controls import ClipControls, LookControls, PlayControls
from imgtransfer.viewing.figure import Facts, Figure
from imgtransfer.viewing.frame import Frame, Motion
from imgtransfer.viewing.live_controls import LiveControls
from imgtransfer.viewing.look import Look
from imgtransfer.viewing.picking import Mark, Ray
from imgtransfer.viewing.sources import Showing, truth_of
from render import InputError

if TYPE_CHECKING:  # a package of an extra
    from viser import SceneApi, ViserServer

    from imgtransfer.viewing.live import LiveMotion

_SKY, _GROUND = (255, 255, 255), (150, 150, 160)
_IDLE_S = 0.5  # between looks at whether somebody has come, while something plays


class Show:
    """Everything on the page. Controls only say that something has changed; `run` reads what they say, and draws.

    Args:
        server: of the page.
        clips: what there is to see of each clip (`open_sources`); may be empty, where only the live garment is shown.
        live: its controls' model; None offers no live garment.
    """

    def __init__(
        self, server: ViserServer, clips: dict[str, tuple[Showing, ...]], live: LiveControls | None = None
    ) -> None:
        self._server = server
        self._changed = threading.Condition()
        self._waiting, self._picks = True, deque[Ray](maxlen=1)
        self._clock = Clock()
        server.scene.set_up_direction("+y")
        _light(server.scene)
        self._clip = ClipControls(server.gui, clips, self.notify) if clips else None
        self._play = PlayControls(server.gui, self._go_to, self.notify) if clips else None
        self._look = LookControls(server.gui, self.notify)
        self._live = live
        if live is not None:
            live.build(server.gui, self.notify)
        self._cameras = Cameras(server, self._look.linked)
        self._showings: tuple[Showing, ...] = ()
        self._figures: list[Figure] = []
        self._live_figure: Figure | None = None
        self._last: tuple[object, ...] = ()
        # Of the clip that was asked for; what the page says of it stays until another is asked for.
        self._unreadable: InputError | None = None
        self._fault: InputError | None = None  # of what is shown now
        server.scene.on_click()(self._clicked)

    def notify(self) -> None:
        """Something has changed."""
        with self._changed:
            self._waiting = True
            self._changed.notify()

    def run(self) -> None:
        """Draw until a signal stops the program."""
        while True:
            with self._changed:
                if not self._waiting:
                    self._changed.wait(self._pause())
                self._waiting = False
            self.step()

    def step(self) -> None:
        """Draw what has been asked for by now, if anything is new.

        What cannot be read the page says, and goes on with the rest.
        """
        try:
            self._load()
        except InputError as error:
            self._unreadable = error
        self._take_picks()
        self._draw()

    def draw(self) -> None:
        """As `step`, for the first time.

        Raises:
            InputError: what is asked for cannot be read.
        """
        self.step()
        if self._fault is not None:
            raise self._fault

    def _pause(self) -> float | None:
        """Seconds until there may be something new; None where only a person makes something new."""
        if self._play is None or not self._play.playing:
            return None
        if not self._server.get_clients():
            return _IDLE_S
        return self._clock.until_next()

    def _load(self) -> None:
        """Take on the clip that is asked for."""
        if self._clip is None or self._play is None or self._clip.showings == self._showings:
            return
        showings = self._clip.showings
        new_clip = [one.clip for one in showings[:1]] != [one.clip for one in self._showings[:1]]
        self._showings = showings
        for figure in self._figures:
            figure.remove()
        self._figures, self._last, self._unreadable = [], (), None
        motions = motions_of(showings, truth_of(showings))
        self._figures = [
            Figure(self._server.scene, f"/clip/{number}", motion, self._pointed)
            for number, motion in enumerate(motions)
        ]
        if new_clip:
            self._look.mark, self._look.scaled = None, "cloth"
            self._clock.start(max(motion.n_frames for motion in motions), motions[0].fps)
            self._play.set_clip(self._clock.n_frames, motions[0].fps)

    def _draw(self) -> None:
        """Draw what is new."""
        self._fault = self._unreadable
        live = self._live_motion()
        frame, look = self._frame(), self._look.look
        fault = str(self._fault or "")
        if (frame, look, live, fault) == self._last:
            return
        self._with_live(live)
        drawn = [(figure, one) for figure in self._all() if (one := self._read(figure, frame)) is not None]
        if look.colours != self._look.scaled:
            look = self._scaled(look, drawn)
        with self._server.atomic():
            self._lay_out(self._all(), look)
            facts = [of for figure, one in drawn if (of := self._facts(figure, one, look)) is not None]
            if self._play is not None:
                self._play.show_frame(frame)
        if self._fault is not None and self._play is not None:
            self._play.pause()
        self._look.show(look, facts, self._note(look, facts))
        self._last = (frame, look, live, fault)

    def _live_motion(self) -> LiveMotion | None:
        """The live garment as it is asked for; None where there is none, or it cannot be had."""
        try:
            return None if self._live is None else self._live.motion()
        except InputError as error:
            self._fault = error
            return None

    def _read(self, figure: Figure, frame: int) -> Frame | None:
        """A figure's frame; None where it cannot be read: the figure then stays as it was."""
        try:
            return figure.motion.frame(min(frame, figure.motion.n_frames - 1))
        except InputError as error:
            self._fault = error
            return None

    def _facts(self, figure: Figure, frame: Frame, look: Look) -> Facts | None:
        """Draw a figure; what there is to say of it, None where its maps cannot be read."""
        try:
            return figure.draw(frame, look)
        except InputError as error:
            self._fault = error
            return None

    def _note(self, look: Look, facts: list[Facts]) -> str:
        if self._fault is not None:
            return str(self._fault)
        if look.colours == "error" and not any(fact.mean for fact in facts):
            return "No error to show: it is measured against the first source that is no prediction; open that, too."
        return ""

    def _frame(self) -> int:
        if self._play is None:
            return 0
        self._clock.set(self._play.playing and bool(self._server.get_clients()), self._play.rate)
        return self._clock.frame()

    def _all(self) -> list[Figure]:
        return self._figures + ([] if self._live_figure is None else [self._live_figure])

    def _with_live(self, live: Motion | None) -> None:
        """Show the live garment, or not."""
        shown = self._live_figure
        if shown is not None and (live is None or shown.motion.dress is not live.dress):
            shown.remove()
            shown = None
        if live is not None and shown is None:
            shown = Figure(self._server.scene, "/live", live, self._pointed)
        elif live is not None and shown is not None:
            shown.motion = live
        self._live_figure = shown

    def _scaled(self, look: Look, drawn: list[tuple[Figure, Frame]]) -> Look:
        """The look with a scale that suits its new colours."""
        values = [
            of
            for figure, frame in drawn
            if (of := figure.motion.dress.values(frame, look.colours)) is not None
        ]
        if look.colours in UNITS and not values:
            return look
        limit = round_limit(np.concatenate(values)) if values else look.limit
        self._look.set_scale(look.colours, limit)
        return self._look.look

    def _lay_out(self, figures: list[Figure], look: Look) -> None:
        """Figures side by side, the whole around the origin."""
        widths = [figure.width(maps=look.maps != "none") for figure in figures]
        left = -sum(widths) / 2
        for figure, width in zip(figures, widths, strict=True):
            figure.put(np.array([left + figure.half_width, 0.0, 0.0]))
            left += width
        if figures:
            bottom, top = min(figure.bottom for figure in figures), max(figure.top for figure in figures)
            self._cameras.frame(sum(widths), bottom, top)

    def _go_to(self, frame: int) -> None:
        self._clock.go_to(frame)
        self.notify()

    def _clicked(self, event: object) -> None:
        """Called by threads of the server."""
        origin, direction = (
            np.array(getattr(event, name), np.float64) for name in ("ray_origin", "ray_direction")
        )
        self._pointed(Ray(origin, direction))

    def _pointed(self, ray: Ray) -> None:
        self._picks.append(ray)
        self.notify()

    def _take_picks(self) -> None:
        """Mark what was clicked last; a click past everything leaves the mark."""
        while self._picks:
            ray = self._picks.popleft()
            hits = [hit for figure in self._all() if (hit := figure.picked(ray)) is not None]
            mark: Mark | None = min(hits, key=lambda hit: hit[0])[1] if hits else None
            if mark is not None:
                self._look.mark = mark


def _light(scene: SceneApi) -> None:
    """Light from all around: viser's own, from a photograph, takes long where there is no GPU, and casts shadows."""
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False)
    scene.add_light_hemisphere("/light/sky", sky_color=_SKY, ground_color=_GROUND, intensity=1.3)
    for name, place, intensity in (("front", (1.5, 3.0, 4.0), 1.6), ("back", (-2.0, 3.0, -4.0), 1.2)):
        scene.add_light_directional(f"/light/{name}", position=place, intensity=intensity)
