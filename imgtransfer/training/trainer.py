"""One training run in memory: data, both networks, optimiser, the step it is at."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from imgtransfer.data.source import clip_refs
from imgtransfer.network import map_errors, masked_l1
from imgtransfer.network.kernel_head import LeftOut
from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyMaps, ImagePair, metric_maps
from imgtransfer.network.memory import check_training_memory
from imgtransfer.network.mirror import Garment, Mirror, of_frames
from imgtransfer.training.averaging import WeightAverage
from imgtransfer.training.checkpoint import (
    FORMAT_VERSION,
    MODEL_FILE,
    STATE_FILE,
    STATE_FORMAT,
    averaged_weights,
    fingerprint,
    load_weights,
    optimizer_state,
    read_tensors,
    save_model,
    write_tensors,
)
from imgtransfer.training.config import ClipChoice, RunConfig
from imgtransfer.training.head_fit import fit_head, left_out_groups
from imgtransfer.training.head_state import left_out_heads
from imgtransfer.training.optimizer import build_optimizer, learning_rate, moments, set_moments
from imgtransfer.training.precision import Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.sampler import Frames
from imgtransfer.training.start import new_model, trained_model
from render import InputError, Option

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
        if self.device.type == "cpu":
            check_training_memory(config.network, config.maps, batch_frames=options.batch_frames)
        # Seeded after the data and before the weights: the same seed gives the same run on any amount of
        # data.
        torch.manual_seed(options.seed)
        if options.init is None:
            self.model = new_model(config, self.train_frames).to(self.device)
        else:
            self.model = trained_model(config, self.train_frames, options.init).to(self.device)
        self.init_mark = None if options.init is None else fingerprint(options.init)
        self._bodies = {
            id(f): self.model.body_imager(*f.shapes) for f in (self.train_frames, self.validation_frames)
        }
        self._left_out: LeftOut | None = None
        garment = self._garment(self.train_frames)
        if options.init is None:
            typical = self.train_frames.spread(CALIBRATION_FRAMES)
            self.model.calibrate(self.batch(self.train_frames, typical)[0], garment)
        self.mirror = self._mirror(self.train_frames) if options.mirror else None
        self.model.mirrored_average = options.mirror
        self._shown = garment if self.mirror is None else self.mirror.both(garment)
        self.order = self.train_frames.order(options.batch_frames, options.seed)
        self.optimizer = build_optimizer(self.model, options)
        self._average = None if options.ema is None else WeightAverage(self.model, options.ema)
        self.step = 0

    def fit_head(self) -> None:
        """Fit what corrects the first guess, where the configuration wants that; before the first step.

        Raises:
            InputError: damaged data.
        """
        if self.config.network.head.kind == "none":
            return
        garment = self._garment(self.train_frames)
        assert isinstance(garment, TemplateView)  # the configuration sees to it
        self.model.head, self._left_out = fit_head(
            self.model,
            self.train_frames,
            partial(self.batch, self.train_frames),
            covered=garment.covered[0],
            mirror=self.config.training.mirror,
        )

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
        mask, mirrored = self.model.mask, None
        if self.mirror is not None:
            mirrored = self.order.coins(self.step).to(self.device)
            body, truth = self.mirror.body(body, mirrored), self.mirror.garment(truth, mirrored)
            mask = self.mirror.masks(mirrored)
        self.model.train()
        if self.config.network.dropout:
            torch.manual_seed(self.order.step_seed(self.step))  # a resumed run draws the same
        with self._autocast():
            garment, tokens = self._shown, self.model.encode_garment(self._shown)
            if mirrored is not None:
                garment, tokens = of_frames((garment, tokens), mirrored)
            predicted = self.model(body, garment=garment, tokens=tokens)
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
        if self._average is not None:
            self._average.update(self.step)
        return {
            "position_loss": position_loss.item(),
            "normal_loss": normal_loss.item(),
            "learning_rate": rate,
        }

    @torch.no_grad()
    def batch(self, frames: Frames, index: Tensor) -> tuple[BodyMaps, ImagePair]:
        """What the networks are shown of frames `index` (B,) int64, and the true images, (B, S, H, W, 3) each.

        The first guess of a training frame is by a head that has not seen its clip, as that of new frames will be.
        """
        garment, body_vertices, shape = frames.read(index)
        imager, earlier, up = self._bodies[id(frames)], None, None
        if imager.view is not None:
            before, up = frames.earlier(index)
            up = up.to(self.device)
            earlier = imager.view.samples(before.to(self.device)) if before.shape[1] else None
        body = imager(body_vertices.to(self.device), shape.to(self.device), earlier=earlier, up=up)
        left_out, values = self._left_out, None
        if left_out is not None and frames is self.train_frames:
            values = partial(left_out.values, index=index)
        body = self.model.guessed(body, values)
        positions, normals = metric_maps(self.model.imager, garment.to(self.device))
        return body, ImagePair.encode(positions, normals, self.model.mask, self.model.box)

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Mean errors over the covered pixels of frames spread over the validation clips, predicted as
        `imgtransfer predict` does.

        Returns:
            position_mm, the distance to the true position; normal_degrees, the angle to the true normal; and
            where there is a first guess the same of it, as guess_position_mm and guess_normal_degrees.
        """
        self.model.eval()
        sums: dict[str, float] = {}
        index = self.validation_frames.spread(self.config.data.validation_frames)
        for part in index.split(VALIDATION_BATCH):
            body, truth = self.batch(self.validation_frames, part)
            with self._autocast(), self._result():
                predicted = self._predicted(body)
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

    def _garment(self, frames: Frames) -> Garment:
        """The template as the networks see it."""
        return self.model.seen(self._bodies[id(frames)])

    def _mirror(self, frames: Frames) -> Mirror:
        return Mirror(self.model.imager, self.model.mask, self._bodies[id(frames)].mask, self.model.box)

    def _predicted(self, body: BodyMaps) -> ImagePair:
        """Images for maps of validation frames."""
        garment = self._garment(self.validation_frames)
        if not self.model.mirrored_average:
            images: ImagePair = self.model(body, garment=garment)
            return images
        mirror = self._mirror(self.validation_frames)
        return self.model.averaged(body, mirror, self.model.versions(garment, mirror))

    def _result(self) -> AbstractContextManager[None]:
        """Within, the model has the weights that the run's result has: the averaged ones where they are averaged."""
        return nullcontext() if self._average is None else self._average.in_place()

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision.name == "bfloat16")

    def save(self, folder: Path) -> None:
        """Write the state to resume from, then the model; each file appears whole or not at all."""
        tensors = {f"model.{key}": value for key, value in self.model.state_dict().items()}
        for number, its in moments(self.model, self.optimizer).items():
            tensors |= {f"optimizer.{number}.{key}": value for key, value in its.items()}
        if self._average is not None:
            tensors |= {f"average.{key}": value for key, value in self._average.tensors().items()}
        if self._left_out is not None:
            tensors |= {f"left_out.{key}": value for key, value in self._left_out.tensors().items()}
        header = {"format": STATE_FORMAT, "format_version": FORMAT_VERSION, "step": self.step, **self._box()}
        write_tensors(folder / STATE_FILE, tensors, header | {"init": self.init_mark})
        with self._result():
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
        if header.get("init") != self.init_mark:
            raise InputError(
                f"{path}: the run began with another model than {self.config.training.init} is now; put that one "
                f"back, or start a new run with another {Option('out')}"
            )
        load_weights(self.model, tensors, path)
        if self.model.head is not None:
            group = left_out_groups(self.train_frames.clip_starts)
            self._left_out = left_out_heads(tensors, self.model.head, group, path)
        state = optimizer_state(tensors, list(self.model.parameters()), path, begun=step > 0)
        set_moments(self.model, self.optimizer, state)
        if self._average is not None:
            self._average.load(averaged_weights(tensors, self.model, path))
        self.step = step

    def _box(self) -> dict[str, list[float]]:
        """The position box as headers have it, by which other training data are noticed."""
        return {"box_lo": self.model.box.lo.tolist(), "box_hi": self.model.box.hi.tolist()}


def _device(wanted: str) -> str:
    if wanted == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if wanted == "cuda" and not torch.cuda.is_available():
        raise InputError("training.device is cuda, but torch finds no CUDA device; use auto or cpu")
    return wanted
