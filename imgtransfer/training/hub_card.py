"""The model card of a trained model, filled in from its run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imgtransfer.network import TransferModel
from imgtransfer.training.config import RunConfig
from imgtransfer.training.kept import MEASURE

_NUMBERS = {
    "position_mm": "position maps: mean distance, mm",
    "normal_degrees": "normal maps: mean angle, degrees",
    "guess_position_mm": "first guess, before the networks: mean distance, mm",
    "guess_normal_degrees": "first guess: mean angle, degrees",
    "fused_rmse_mm": "fused vertices: RMSE, mm",
    "fused_sted": "fused vertices: STED",
}


def model_card(
    name: str,
    model: TransferModel,
    config: RunConfig,
    entries: Sequence[Mapping[str, Any]],
    *,
    licence: str,
    data: str,
) -> str:
    """Markdown with the hub's front matter.

    Args:
        name: of the model. model: the trained one.
        config: of its run. entries: of the run's log, up to the model's step.
        licence: of the weights, as the hub names it. data: what the training clips are called.
    """
    facts = _facts(model, config, entries, data)
    numbers = _numbers(entries)
    return "\n".join(
        [
            "---",
            "library_name: imgtransfer",
            f"license: {licence}",
            "tags: [garment, cloth, animation]",
            "---",
            "",
            f"# {name}",
            "",
            "Deforms a garment by image transfer: maps of the posed body in, position and normal maps of the "
            "garment out, which `imgtransfer` fuses to a mesh.",
            "",
            "```bash",
            f"imgtransfer predict {name} CLIPS --out predictions",
            "imgtransfer fuse predictions",
            "```",
            "",
            "```python",
            "from imgtransfer.training.hub import from_pretrained",
            "",
            f'model = from_pretrained("{name}")  # or "OWNER/{name}"',
            "```",
            "",
            "## Training",
            "",
            *_table(("", ""), facts),
            "",
            "## Numbers",
            "",
            "Of frames spread over the validation clips, which were not trained on but by which settings may have been "
            "chosen:",
            "",
            *_table(("", "value"), numbers),
            "",
            "## Licence",
            "",
            f"The weights: {licence}. Look at the licence of the training clips, too.",
            "",
        ]
    )


def _facts(
    model: TransferModel, config: RunConfig, entries: Sequence[Mapping[str, Any]], data: str
) -> dict[str, str]:
    options, encoder = config.training, config.network.encoder
    first = entries[0] if entries else {}
    counts = ", ".join(f"{first[key]:,} {key}" for key in ("clips", "frames", "garments") if key in first)
    mesh = model.imager.mesh
    steps = int(entries[-1]["step"]) if entries else 0
    return {
        "data": f"{data} ({counts})" if counts else data,
        "garment": "any, imaged through its own template"
        if model.general
        else f"one: {len(mesh.vertices):,} vertices, {len(mesh.faces):,} faces",
        "maps": f"{' x '.join(map(str, config.maps.size))} pixels, {len(model.imager.cameras)} images",
        "networks": f"encoder {encoder.kind}, {sum(weight.numel() for weight in model.parameters()):,} weights",
        "steps": f"{steps:,} of {options.batch_frames * options.accumulate} frames in each process",
        "optimiser": f"{options.optimizer}, learning rate {options.learning_rate:g}, {options.schedule}",
        "seed": str(options.seed),
    }


def _numbers(entries: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """The last validation's; what is fused may be of another step."""
    numbers = {}
    for key, meaning in _NUMBERS.items():
        values = [entry[key] for entry in entries if isinstance(entry.get(key), int | float)]
        if values:
            numbers[meaning] = f"{values[-1]:.3g}"
    before = [entry[MEASURE] for entry in entries if entry["step"] == 0 and MEASURE in entry]
    return numbers | (
        {"position maps before training: mean distance, mm": f"{before[0]:.3g}"} if before else {}
    )


def _table(head: tuple[str, str], rows: Mapping[str, str]) -> list[str]:
    return [
        f"| {' | '.join(head)} |",
        "| --- | --- |",
        *(f"| {key} | {value} |" for key, value in rows.items()),
    ]
