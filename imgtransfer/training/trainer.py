"""One training run in memory: data, both networks, optimiser, the step it is at."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from imgtransfer.data.source import clip_refs
from imgtransfer.network import TransferModel, map_errors, masked_l1
from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyMaps, ImagePair, metric_maps
from imgtransfer.network.memory import check_training_memory
from imgtransfer.training.checkpoint import (
    FORMAT_VERSION,
    MODEL_FILE,
    STATE_FILE,
    STATE_FORMAT,
    load_weights,
    optimizer_state,
    read_tensors,
    save_model,
    write_tensors,
)
from imgtransfer.training.config import ClipChoice, RunConfig, TrainingConfig
from imgtransfer.training.mirror import Mirror
from imgtransfer.training.precision import Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.sampler import Frames
from render import InputError, Mesh, Option, PositionBox

VALIDATION_BATCH = 16
CALIBRATION_FRAMES = 64


class Trainer:
    """One run: data, model, optimiser and the step it is at.

    Args:
        config: everything about the run.

    Raises:
        InputError: data that cannot be read, or that does not fit the configuration.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config, options = config, config.training
        if options.threads:
            torch.set_num_threads(options.threads)
        self.device = torch.device(_device(options.device))
        self.train_frames = self._frames(config.data.train)
        self.validation_frames = self._frames(config.data.validation)
        workload = Workload.of(config.maps, config.network, options.batch_frames)
        self.precision = choose_precision(options.precision, partial(bfloat16_ratio, self.device, workload))
        first = self.train_frames.first
        if self.device.type == "cpu":
            check_training_memory(config.network, config.maps, batch_frames=options.batch_frames)
        # Seeded after the data and before the weights: the same seed gives the same run on any amount of
        # data.
        torch.manual_seed(options.seed)
        self.model = TransferModel(
            maps=config.maps,
            network=config.network,
            template=Mesh(first.template.vertices, first.template.faces, first.name),
            box=PositionBox.around(self.train_frames.garment_bounds()),
            body=Mesh(first.body.rest, first.body.faces, first.name),
        ).to(self.device)
        self._bodies = {
            id(f): self.model.body_imager(*f.shapes) for f in (self.train_frames, self.validation_frames)
        }
        typical = self.train_frames.spread(CALIBRATION_FRAMES)
        self.model.calibrate(self.batch(self.train_frames, typical)[0], self._garment(self.train_frames))
        self.mirror = None
        if options.mirror:
            body_mask = self._bodies[id(self.train_frames)].mask
            self.mirror = Mirror(self.model.imager, self.model.mask, body_mask, self.model.box)
        self.order = self.train_frames.order(options.batch_frames, options.seed)
        kind = torch.optim.Adam if options.optimizer == "adam" else torch.optim.AdamW
        self.optimizer = kind(
            self.model.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay, fused=True
        )
        self.step = 0

    def train_step(self) -> dict[str, float]:
        """One optimisation step on the next batch, of both networks.

        Returns:
            What the log says about it: position_loss and normal_loss (masked L1 of encoded images, equation 3), and the
            learning_rate.

        Raises:
            InputError: damaged data.
        """
        options = self.config.training
        rate = learning_rate(options, self.step)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        body, truth = self.batch(self.train_frames, self.order.frames(self.step))
        garment, mask = self._garment(self.train_frames), self.model.mask
        if self.mirror is not None and self.order.coin(self.step):
            body, truth = self.mirror.body(body), self.mirror.garment(truth)
            garment = self.mirror.seen(garment)
            mask = self.mirror.mask
        self.model.train()
        with self._autocast():
            predicted = self.model(body, garment=garment)
        position_loss = masked_l1(predicted.positions, truth.positions, mask)
        normal_loss = masked_l1(predicted.normals, truth.normals, mask)
        self.optimizer.zero_grad()
        # The networks share no weight, so the sum trains each by its own loss (equation 3).
        (position_loss + normal_loss).backward()
        if options.gradient_clip is not None:
            for network in (self.model.position_net, self.model.normal_net):
                nn.utils.clip_grad_norm_(network.parameters(), options.gradient_clip)
        self.optimizer.step()
        self.step += 1
        return {
            "position_loss": position_loss.item(),
            "normal_loss": normal_loss.item(),
            "learning_rate": rate,
        }

    @torch.no_grad()
    def batch(self, frames: Frames, index: Tensor) -> tuple[BodyMaps, ImagePair]:
        """What the networks are shown of frames `index` (B,) int64, and the true images, (B, S, H, W, 3) each."""
        garment, body_vertices, shape = frames.read(index)
        imager, earlier, up = self._bodies[id(frames)], None, None
        if imager.view is not None:
            before, up = frames.earlier(index)
            up = up.to(self.device)
            earlier = imager.view.samples(before.to(self.device)) if before.shape[1] else None
        body = imager(body_vertices.to(self.device), shape.to(self.device), earlier=earlier, up=up)
        positions, normals = metric_maps(self.model.imager, garment.to(self.device))
        return body, ImagePair.encode(positions, normals, self.model.mask, self.model.box)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean errors over the covered pixels of frames spread over the validation clips.

        Returns:
            position_mm, the distance to the true position; normal_degrees, the angle to the true normal; and
            where there is a first guess the same of it, as guess_position_mm and guess_normal_degrees.
        """
        self.model.eval()
        sums: dict[str, float] = {}
        index = self.validation_frames.spread(self.config.data.validation_frames)
        for part in index.split(VALIDATION_BATCH):
            body, truth = self.batch(self.validation_frames, part)
            with self._autocast():
                predicted = self.model(body, garment=self._garment(self.validation_frames))
            errors = map_errors(predicted, truth, self.model.mask, self.model.box)
            if body.guess is not None:
                guess = ImagePair.encode(
                    body.guess.positions, body.guess.normals, self.model.mask, self.model.box
                )
                of_guess = map_errors(guess, truth, self.model.mask, self.model.box)
                errors |= {f"guess_{key}": value for key, value in of_guess.items()}
            for key, value in errors.items():
                sums[key] = sums.get(key, 0.0) + value * len(part) / len(index)
        return sums

    def _frames(self, choice: ClipChoice) -> Frames:
        data = self.config.data
        refs = clip_refs(data.source, split=choice.split, names=choice.names, exclude=choice.exclude)
        readers, root = [ref.reader() for ref in refs], self.config.maps.root
        history = self.config.network.history_s
        return Frames(readers, root, int(data.cache_gb * 1e9), history_s=history)

    def _garment(self, frames: Frames) -> ImagePair | TemplateView:
        """The template as the networks see it."""
        return self.model.seen(self._bodies[id(frames)])

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision.name == "bfloat16")

    def save(self, folder: Path) -> None:
        """Write the state to resume from, then the model; each file appears whole or not at all."""
        tensors = {f"model.{key}": value for key, value in self.model.state_dict().items()}
        for index, moments in self.optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer.{index}.{key}": value for key, value in moments.items()}
        header = {"format": STATE_FORMAT, "format_version": FORMAT_VERSION, "step": self.step, **self._box()}
        write_tensors(folder / STATE_FILE, tensors, header)
        save_model(folder / MODEL_FILE, self.model, stored=self.config.training.stored, steps=self.step)

    def load(self, folder: Path) -> None:
        """Go on where `save` left off.

        Raises:
            InputError: a state that is damaged, of another architecture, or trained on other data.
        """
        path = folder / STATE_FILE
        tensors, header = read_tensors(path, STATE_FORMAT)
        step, box = header.get("step"), {key: header.get(key) for key in self._box()}
        if not isinstance(step, int) or isinstance(step, bool) or step < 0:
            raise InputError(
                f"{path}: damaged, its step is {step!r}; choose another {Option('out')} for a new run"
            )
        if box != self._box():
            raise InputError(
                f"{path}: the training data have changed since; start a new run with another {Option('out')}"
            )
        load_weights(self.model, tensors, path)
        state = optimizer_state(tensors, list(self.model.parameters()), path, begun=step > 0)
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": state, "param_groups": groups})
        self.step = step

    def _box(self) -> dict[str, list[float]]:
        """The position box as headers have it, by which other training data are noticed."""
        return {"box_lo": self.model.box.lo.tolist(), "box_hi": self.model.box.hi.tolist()}


def learning_rate(options: TrainingConfig, step: int) -> float:
    """The rate of step 0, 1, ...: a linear warm-up, then constant or half a cosine down to 0 at the end."""
    if step < options.warmup_steps:
        return options.learning_rate * (step + 1) / options.warmup_steps
    if options.schedule == "constant":
        return options.learning_rate
    done = (step - options.warmup_steps) / max(options.steps - options.warmup_steps, 1)
    return options.learning_rate * (1 + math.cos(math.pi * done)) / 2


def _device(wanted: str) -> str:
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise InputError("training.device is cuda, but torch finds no CUDA device; use auto or cpu")
    return wanted
