"""Controls of the live garment: which, on what body, in which pose."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from imgtransfer.bodies.shape import AnnyShape
from imgtransfer.viewing.controls import put, when_changed

if TYPE_CHECKING:  # a package of an extra, and what takes long to import
    from viser import GuiApi, GuiInputHandle

    from imgtransfer.viewing.live import LiveModel, LiveMotion, Worn

# Degrees: least, most, and at first.
_RANGES = {
    "arms up": (-75, 75, -50),
    "elbows": (0, 130, 15),
    "left leg forward": (-40, 110, 0),
    "right leg forward": (-40, 110, 0),
    "knees": (0, 120, 0),
    "lean forward": (-20, 60, 0),
    "twist": (-50, 50, 0),
}
_KINDS = ("tshirt", "dress", "trousers", "skirt")
_RATIO_STEP = 0.01


class LiveControls:
    """The live garment, while it is switched on.

    Args:
        path: where the model is, which is read when it is switched on first.
        on: whether it is on at first.
    """

    def __init__(self, path: Path, *, on: bool) -> None:
        self._path, self._begin = path, on
        self._model: LiveModel | None = None
        self._worn: tuple[tuple[str, AnnyShape], Worn] | None = None
        self._last: tuple[object, LiveMotion] | None = None

    def check(self) -> None:
        """Read the model now.

        Raises:
            InputError: it cannot be read, or is of one garment only.
        """
        self._loaded().check()

    def build(self, gui: GuiApi, changed: Callable[[], None]) -> None:
        """Put the controls on the page; `changed` is called where a person changes something."""
        with gui.add_folder("Live garment", expand_by_default=self._begin):
            self._on = gui.add_checkbox(
                "predict live", self._begin, hint="the first garment takes a moment, poses much less"
            )
            self._fused = gui.add_checkbox("fuse", True, hint="off: vertices are read from the position maps")
            self._kind = gui.add_dropdown("garment", _KINDS)
            self._took = gui.add_text("took", "", disabled=True)
            self._turns: dict[str, GuiInputHandle[int]] = {
                name: gui.add_slider(name, low, high, 1, start, hint="degrees")
                for name, (low, high, start) in _RANGES.items()
            }
            with gui.add_folder("Body"):
                self._shape: dict[str, GuiInputHandle[float]] = {
                    name: gui.add_slider(
                        name, _lowest(name), 1.0, _RATIO_STEP, float(field.default), hint=field.description
                    )
                    for name, field in AnnyShape.model_fields.items()
                }
        for handle in (self._on, self._fused, self._kind, *self._turns.values(), *self._shape.values()):
            when_changed(handle, changed)

    def motion(self) -> LiveMotion | None:
        """What is to be shown: the same object while nothing has changed; None where it is switched off.

        Raises:
            InputError: the model cannot be read, or the garment not be predicted.
        """
        if not self._on.value:
            return None
        shape = AnnyShape(**{name: float(handle.value) for name, handle in self._shape.items()})
        degrees = {name: float(handle.value) for name, handle in self._turns.items()}
        fused, outfit = bool(self._fused.value), (str(self._kind.value), shape)
        asked = (outfit, degrees, fused)
        if self._last is None or self._last[0] != asked:
            made = ""
            if self._worn is None or self._worn[0] != outfit:
                put(self._took, "preparing the garment …")
                start = time.perf_counter()
                self._worn = outfit, self._prepared(*outfit)
                made = f"; garment and body {1000 * (time.perf_counter() - start):.0f} ms"
            shown = self._worn[1].posed(degrees, fused=fused)
            predicted, merged = shown.milliseconds
            put(self._took, f"{predicted:.0f} ms" + (f" + fusion {merged:.0f} ms" if fused else "") + made)
            self._last = asked, shown
        return self._last[1]

    def _prepared(self, kind: str, shape: AnnyShape) -> Worn:
        return self._loaded().worn(kind, shape)

    def _loaded(self) -> LiveModel:
        from imgtransfer.viewing.live import LiveModel  # noqa: PLC0415 (PyTorch, which a page of clips may not need)

        if self._model is None:
            self._model = LiveModel(self._path)
        return self._model


def _lowest(name: str) -> float:
    """The least value of a shape's parameter."""
    limits = [limit.ge for limit in AnnyShape.model_fields[name].metadata if hasattr(limit, "ge")]
    return float(max(limits))
