"""Whether the validation error of a run still falls, and what to look at where it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imgtransfer.training.config import TrainingConfig
from imgtransfer.training.kept import MEASURE

VALIDATIONS = 5  # the last ones that are compared with all before
GAIN = 0.01  # of the error: what counts as better


def what_to_look_at(entries: Sequence[Mapping[str, Any]], options: TrainingConfig) -> list[str]:
    """Sentences about a run whose validation error stands still; none where it falls, or it is too early to say.

    Args:
        entries: of the log, in order.
        options: of the training.
    """
    validations = [entry for entry in entries if isinstance(entry.get(MEASURE), int | float)]
    if len(validations) <= VALIDATIONS:
        return []
    before, last = validations[:-VALIDATIONS], validations[-VALIDATIONS:]
    best_before, best_last = (min(entry[MEASURE] for entry in some) for some in (before, last))
    if best_last < (1 - GAIN) * best_before:
        return []
    said = [
        f"The last {VALIDATIONS} validations are not better than those before: {best_last:.2f} mm at best, "
        f"where it was {best_before:.2f} mm."
    ]
    falls = _training_falls(entries, int(before[-1]["step"]), int(last[0]["step"]))
    if falls is None:
        return said
    if falls:
        said.append(
            "The training loss still falls, so the networks learn the training clips by heart: stop, and take "
            "best.safetensors; more clips, motions and bodies help most, then training.weight_decay (0.5), "
            "network.dropout (0.1), training.ema (0.99) and training.mirror."
        )
    else:
        said.append(
            "The training loss stands still, too: look at the learning rate first, which may be too high to settle "
            f"(training.schedule: cosine; {options.schedule} now) or too low to go on; then at the networks' size."
        )
    guess = last[-1].get(f"guess_{MEASURE}")
    if isinstance(guess, int | float) and guess < best_last:
        said.append(
            f"The first guess is better than what the networks make of it ({guess:.2f} mm): the learning rate is too "
            "high, or the validation clips are too unlike the training clips."
        )
    said.append(
        "The worst frame below tells whether it is a motion, a body or a garment that the training lacks."
    )
    return said


def _training_falls(entries: Sequence[Mapping[str, Any]], early: int, late: int) -> bool | None:
    """Whether the position loss is lower after step `late` than up to `early`; None where there are too few steps."""
    losses = [
        (int(entry["step"]), float(entry["position_loss"])) for entry in entries if "position_loss" in entry
    ]
    first = [loss for step, loss in losses if early // 2 < step <= early]
    last = [loss for step, loss in losses if step > late]
    if not first or not last:
        return None
    return sum(last) / len(last) < (1 - GAIN) * sum(first) / len(first)
