"""`report.html` of a run: how far it is, its curves, frames over time, and what to look at when nothing gets better."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from imgtransfer.report.html import write_page
from imgtransfer.report.logs import read_curves, read_entries
from imgtransfer.report.page_pictures import fitting_uris
from imgtransfer.report.svg import line_plot
from imgtransfer.training.log import LOG_FILE
from imgtransfer.training.progress_pictures import LIMIT_MM, frame_sheet, predicted_sheet, true_sheet
from imgtransfer.training.remaining import duration
from imgtransfer.training.standstill import what_to_look_at
from imgtransfer.training.trainer import Trainer
from render import write_png

_log = logging.getLogger(__name__)

PAGE_FILE, PICTURES_FOLDER = "report.html", "progress"
FIXED_FRAMES = 3
_SHOWN = 8  # steps whose pictures the page has, the first and the last among them
_PLOTS = {  # title: names by keys of the log
    "training loss": {"position_loss": "positions", "normal_loss": "normals"},
    "validation, mm": {
        "position_mm": "position maps",
        "guess_position_mm": "first guess",
        "fused_rmse_mm": "fused",
    },
    "validation, degrees": {"normal_degrees": "normal maps", "guess_normal_degrees": "first guess"},
    "STED, fused": {"fused_sted": "fused"},
    "learning rate": {"learning_rate": "rate"},
}


@dataclass(frozen=True)
class Pace:
    """How fast a process trains.

    Args:
        step_seconds: of one step; None where it has done none.
        validation_seconds: of the last validation.
    """

    step_seconds: float | None
    validation_seconds: float


class ProgressPage:
    """Writes the page of a run, and the pictures that it is made of.

    Args:
        trainer: of the run. out: its folder.
    """

    def __init__(self, trainer: Trainer, out: Path) -> None:
        self._trainer, self._out = trainer, out
        frames = trainer.validation_frames
        middle = (torch.arange(FIXED_FRAMES) + 0.5) / FIXED_FRAMES * len(frames)
        self._fixed = middle.long().unique()

    def write(self, pace: Pace) -> None:
        """Write it after a validation, whose entry is in the log."""
        trainer, page = self._trainer, self._out / PAGE_FILE
        pictures = self._out / PICTURES_FOLDER
        labels = [trainer.validation_frames.label(frame) for frame in self._fixed.tolist()]
        shown = trainer.images(self._fixed)
        write_png(pictures / f"{trainer.step:09d}.png", predicted_sheet(shown, labels))
        steps, worst = self._steps(pictures), trainer.validation.worst
        images = [true_sheet(shown, labels), *(image for _, image in steps)]
        if worst is not None:
            images += [frame_sheet(trainer.images(torch.tensor([worst[0]]))[0])]
        sources, factor = fitting_uris(images, ("jpeg",))
        entries, _ = read_entries(self._out / LOG_FILE)
        write_page(
            page,
            "training_page.html",
            title=f"Training {self._out.resolve().name}",
            facts=self._facts(pace),
            advice=what_to_look_at(entries, trainer.config.training),
            plots=self._plots(),
            limit=f"{LIMIT_MM:.0f}",
            labels=", ".join(labels),
            truth=sources[0],
            steps=[(f"{step:,}", source) for (step, _), source in zip(steps, sources[1:], strict=False)],
            worst=None if worst is None else (self._about(*worst), sources[-1]),
            percent=round(100 * factor),
            folder=PICTURES_FOLDER,
        )

    def _facts(self, pace: Pace) -> dict[str, str]:
        trainer, options = self._trainer, self._trainer.config.training
        left = options.steps - trainer.step
        best = trainer.best
        facts = {
            "steps": f"{trainer.step:,} of {options.steps:,}, of {trainer.frames_a_step} frames each",
            "data": f"{len(trainer.train_frames):,} frames of {len(trainer.train_frames.readers)} clips, "
            f"{len(trainer.train_frames.outfits)} garments; {len(trainer.validation_frames.readers)} clips to validate",
            "device": f"{trainer.device}, {trainer.precision.name}, {trainer.processes.count} processes",
            "best validation": f"{best.error:.2f} mm at step {best.step:,}",
        }
        if pace.step_seconds is not None:
            validations = left // options.validate_every_steps
            seconds = left * pace.step_seconds + validations * pace.validation_seconds
            facts["speed"] = f"{trainer.frames_a_step / pace.step_seconds:.3g} frames a second"
            facts["time left"] = f"about {duration(seconds)}" if left else "none, it has ended"
        return facts

    def _plots(self) -> list[str]:
        plots = []
        for title, keys in _PLOTS.items():
            curves = read_curves(self._out / LOG_FILE, keys)
            if any(len(x) > 1 for x, _ in curves.values()):
                plots.append(line_plot(curves, title=title, x_label="steps"))
        return plots

    def _steps(self, pictures: Path) -> list[tuple[int, np.ndarray]]:
        """Steps, evenly spread over those that have pictures, each with its picture."""
        files = {int(path.stem): path for path in pictures.glob("[0-9]*.png")}
        known = sorted(step for step in files if step <= self._trainer.step)
        places = np.linspace(0, len(known) - 1, min(_SHOWN, len(known))).round().astype(int)
        shown = []
        for step in (known[place] for place in places):
            image = cv2.imread(str(files[step]))
            if image is not None:
                shown.append((step, image[..., ::-1]))
        return shown

    def _about(self, frame: int, error_mm: float) -> str:
        """What the worst frame of the last validation is."""
        return f"{self._trainer.validation_frames.label(frame)}: {error_mm:.1f} mm in the mean"
