"""One training run in memory: data, both networks, optimiser, the step it is at."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from itertools import chain
from pathlib import Path

import torch
from torch import Tensor, nn

from imgtransfer.network.kernel_head import LeftOut
from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyMaps, ImagePair, metric_maps
from imgtransfer.training.averaging import WeightAverage
from imgtransfer.training.checkpoint import MODEL_FILE, fingerprint, save_model
from imgtransfer.training.config import RunConfig
from imgtransfer.training.divergence import LossWatch
from imgtransfer.training.geometry import measure_geometry
from imgtransfer.training.head_choice import Choice
from imgtransfer.training.head_fit import GROUPS, fit_head
from imgtransfer.training.head_frames import HeadFrames, reads_networks
from imgtransfer.training.head_state import check_trainable
from imgtransfer.training.image_losses import ImageLosses
from imgtransfer.training.kept import BEST_FILE, Best, keep_checkpoint
from imgtransfer.training.left_out import left_out_groups
from imgtransfer.training.optimizer import build_optimizer, learning_rate
from imgtransfer.training.outfits import Outfit, Outfits
from imgtransfer.training.patch_losses import PatchLosses
from imgtransfer.training.processes import Processes
from imgtransfer.training.sampler import Frames
from imgtransfer.training.start import (
    agreed_precision,
    chosen_frames,
    first_model,
    preparation_mark,
)
from imgtransfer.training.state import Learner, Origin, Progress, load_state, save_state
from imgtransfer.training.validation import FrameImages, Validation
from render import InputError

CALIBRATION_FRAMES, CALIBRATION_OUTFITS = 64, 12


class Trainer:
    """One run: data, model, optimiser and the step it is at; in several processes each has one.

    Args:
        config: everything about the run.

    Raises:
        InputError: data that cannot be read, or that does not fit the configuration.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config, options = config, config.training
        self.processes = Processes.joined(options.device)
        self.device = self.processes.device
        if options.threads:
            torch.set_num_threads(options.threads)
        if options.deterministic and self.device.type == "cuda":
            os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # read at the first product
            torch.use_deterministic_algorithms(True)
        self.train_frames = chosen_frames(config, config.data.train)
        self.validation_frames = chosen_frames(config, config.data.validation)
        self.precision = agreed_precision(config, self.processes)
        # Seeded after the data and before the weights: the same seed gives the same run on any amount of data.
        torch.manual_seed(options.seed)
        self.model = first_model(config, self.train_frames, self.device)
        self.init_mark = None if options.init is None else fingerprint(options.init)
        self._left_out: LeftOut | None = None
        self.head_choice: Choice | None = None  # of this process, if it fitted a head
        frames = (self.train_frames, self.validation_frames)
        self._outfits = {id(some): Outfits(self.model, some, mirrored=options.mirror) for some in frames}
        for clip in chain(*self.validation_frames.outfits):
            self.model.check_garment(clip)  # now: one that is not the model's must not stop the run later
        self.mirror = self._outfits[id(self.train_frames)][0].mirror
        train, of = self.train_frames, self._outfits[id(self.train_frames)]
        shown = partial(self.batch, train)
        self._image_losses = ImageLosses(self.model, train, of, batch=shown, autocast=self._autocast)
        local = config.network.body == "local"
        self._patch_losses = PatchLosses(self.model, train, of, shown) if local else None
        self.validation = Validation(
            self.validation_frames,
            config.data.validation_frames,
            batch=self.batch,
            outfit=self._outfit,
            processes=self.processes,
        )
        if options.init is None:
            self._calibrate()
        self.processes.take_from_main(self.model.state_dict().values())
        self.model.mirrored_average = options.mirror
        self.model.contact_offset_m = self.train_frames.contact_offset()
        self.frames_a_step = options.batch_frames * options.accumulate * self.processes.count
        self.order = self.train_frames.order(self.frames_a_step, options.seed)
        self.optimizer = build_optimizer(self.model, options)
        self._average = self._new_average()
        self.watch = LossWatch(options)
        self.best = Best()
        self.step = 0

    def fit_head(self) -> None:
        """Fit what corrects the first guess, where the configuration wants that; before the first step.

        Where the run begins with a trained model, it is fitted to what that model's networks leave, and these give less
        where that lowers the error of clips left out: they add up. Where the run also ends there, so that the networks
        stay as they are, it is told what they make of each frame.

        Raises:
            InputError: damaged data, or a fit that gives no finite numbers.
        """
        if self.config.network.head.kind == "none":
            return
        if len(self.train_frames.outfits) > 1:
            raise InputError(
                f"network.head.kind is {self.config.network.head.kind}, which is for one garment, and the training "
                f"clips are of {len(self.train_frames.outfits)}; set it to none, or choose clips with data.train.names"
            )
        garment = self._outfits[id(self.train_frames)][0].garment
        assert isinstance(garment, TemplateView)  # the configuration sees to it
        head, left_out, choice = fit_head(
            self.model,
            self.train_frames,
            self._shown_to_head,
            covered=garment.covered[0],
            mirror=self.config.training.mirror,
            reads=reads_networks(self.config.training),
        )
        self.processes.take_from_main([*left_out.tensors().values()])
        self.model.head, self._left_out, self.head_choice = head, left_out, choice
        if choice.reliance != 1:
            for network in (self.model.position_net, self.model.normal_net):
                assert isinstance(network, LocalTransferNet)  # the configuration sees to it
                network.weaken(choice.reliance)
        self.processes.take_from_main(self.model.state_dict().values())
        self._average = self._new_average()

    def _new_average(self) -> WeightAverage | None:
        decay = self.config.training.ema
        return None if decay is None else WeightAverage(self.model, decay)

    def train_step(self) -> dict[str, float]:
        """One optimisation step of both networks, on the next frames of all processes.

        Returns:
            What the log says about it: position_loss and normal_loss (masked L1, equation 3: of encoded images, or of
            residuals of prepared patches), and the learning_rate.

        Raises:
            InputError: damaged data.
            Diverged: a loss that is not finite, or far above what it was; the weights stay as they are then.
        """
        options = self.config.training
        rate = learning_rate(options, self.step)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.model.train()
        self.optimizer.zero_grad()
        losses = {"position_loss": 0.0, "normal_loss": 0.0}
        for part in self.processes.parts(options.accumulate):
            for key, loss in self._gradients(self.step, part).items():
                losses[key] += loss / options.accumulate
        losses = self.processes.mean(losses)
        self.watch.check(self.step + 1, losses)
        for network in (self.model.position_net, self.model.normal_net):
            self.processes.average_gradients(network.parameters())
            if options.gradient_clip is not None:
                nn.utils.clip_grad_norm_(network.parameters(), options.gradient_clip)
        self.optimizer.step()
        self.step += 1
        if self._average is not None:
            self._average.update(self.step)
        return losses | {"learning_rate": rate}

    def _gradients(self, step: int, part: int) -> dict[str, float]:
        """Add the gradients of part 0, 1, ... of a step, one batch; returns the losses of its frames."""
        options = self.config.training
        of_part = slice(part * options.batch_frames, (part + 1) * options.batch_frames)
        index = self.order.frames(step)[of_part]
        mirrored = self.order.coins(step)[of_part].to(self.device) if options.mirror else None
        if self.config.network.dropout:
            torch.manual_seed(self.order.step_seed(step, part))  # a resumed run draws the same
        losses = {"position_loss": 0.0, "normal_loss": 0.0}
        for number, places in self.train_frames.by_outfit(index):
            coins = None if mirrored is None else mirrored[places.to(self.device)]
            some = self._losses(number, index[places], coins)
            fraction = len(places) / len(index)
            # The networks share no trained weight, so the sum trains each by its own loss (equation 3).
            (fraction / options.accumulate * (some[0] + some[1])).backward()
            for key, loss in zip(losses, some, strict=True):
                losses[key] += fraction * loss.item()
        return losses

    def cache_trunks(self, folder: Path) -> None:
        """Compute what is frozen of pretrained encoders once a frame, and keep it in `folder` while the run lasts."""
        options = self.config.training
        self._image_losses.cache_trunks(folder, mirrored=options.mirror, limit=options.trunk_cache_gb * 1e9)

    def rehearse(self, ahead: int = 0) -> None:
        """What takes the time of the next step or one `ahead`, forward and backward; it changes nothing."""
        self.model.train()
        for part in self.processes.parts(self.config.training.accumulate):
            self._gradients(self.step + ahead, part)
        self.optimizer.zero_grad()

    def _losses(self, number: int, index: Tensor, mirrored: Tensor | None) -> tuple[Tensor, Tensor]:
        """Both losses of training frames `index` (B,) of outfit `number`, those where `mirrored` (B,) mirrored."""
        if self._patch_losses is None:
            return self._image_losses(number, index, mirrored)
        with self._autocast():
            return self._patch_losses(number, index, mirrored)

    def prepare(self, folder: Path) -> None:
        """Make what local networks are shown of all training frames, in a file in the run's folder.

        After the head is fitted or read, and before the first step.

        Raises:
            InputError: too little room on the disk, or damaged data.
        """
        if self._patch_losses is None or self.config.training.steps <= self.step:
            return
        weights = None if self.model.head is None else self.model.head.weights
        mark = preparation_mark(self.config, self.train_frames, weights)
        self._patch_losses.prepare(folder, mark)

    @torch.no_grad()
    def batch(self, frames: Frames, index: Tensor) -> tuple[BodyMaps, ImagePair]:
        """What the networks are shown of frames `index` (B,) int64 of one outfit, and the true images.

        The images are (B, S, H, W, 3) each. The first guess of a training frame is by a head that has not seen its
        clip, as that of new frames will be.
        """
        outfit = self._outfit(frames, index)
        garment, body_vertices, shape = frames.read(index)
        imager, earlier, up = outfit.imager, None, None
        if imager.view is not None:
            before, up = frames.earlier(index)
            up = up.to(self.device)
            earlier = imager.view.samples(before.to(self.device)) if before.shape[1] else None
        skinned = frames.skinned(index).to(self.device) if self.config.network.skins else None
        shown = body_vertices.to(self.device), shape.to(self.device)
        body = imager(*shown, earlier=earlier, up=up, skinned=skinned)
        left_out, values = self._left_out, None
        if left_out is not None and frames is self.train_frames:
            values = partial(left_out.values, index=index)
        reads = self.model.head is not None and self.model.head.reads
        body = self.model.guessed(body, outfit.versions() if reads else (), values)
        positions, normals = metric_maps(outfit.model.imager, garment.to(self.device))
        return body, ImagePair.encode(positions, normals, outfit.model.mask, outfit.model.box)

    @torch.no_grad()
    def _shown_to_head(self, index: Tensor) -> HeadFrames:
        """Training frames `index` (B,) as a head is fitted to them."""
        body, truth = self.batch(self.train_frames, index)
        self.model.eval()
        outfit = self._outfit(self.train_frames, index)
        return HeadFrames.of(outfit, body, truth, self.config.training)

    def validate(self) -> dict[str, float]:
        """Mean errors over the covered pixels of frames spread over the validation clips (`Validation`)."""
        self.model.eval()
        with self._result():
            return self.validation()

    def images(self, index: Tensor) -> list[FrameImages]:
        """Predicted and true images of validation frames `index` (B,)."""
        self.model.eval()
        with self._result():
            return self.validation.images(index)

    def geometry(self) -> dict[str, float]:
        """Some validation frames predicted, fused and measured (`measure_geometry`), by the main process."""
        if not self.processes.main:
            return {}
        self.model.eval()
        with self._result():
            return measure_geometry(
                self.model, self.validation_frames.readers, self.config.training.geometry_frames
            )

    @torch.no_grad()
    def _calibrate(self) -> None:
        """Let the networks take their statistics from frames spread over the training clips."""
        index = self.train_frames.spread(CALIBRATION_FRAMES)
        kinds = self.train_frames.by_outfit(index)
        # What is constant for an outfit takes seconds: a few will do.
        few = kinds[:: -(-len(kinds) // CALIBRATION_OUTFITS)]
        shown = []
        for _, places in few:
            outfit = self._outfit(self.train_frames, index[places])
            shown.append((self.batch(self.train_frames, index[places])[0], outfit.garment))
        self.model.calibrate(shown)

    def _outfit(self, frames: Frames, index: Tensor) -> Outfit:
        """That of frames `index` (B,)."""
        ((number, _),) = frames.by_outfit(index)
        return self._outfits[id(frames)][number]

    def _result(self) -> AbstractContextManager[None]:
        """Within, the model has the weights that the run's result has: the averaged ones where they are averaged."""
        return nullcontext() if self._average is None else self._average.in_place()

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision.name == "bfloat16")

    def save(self, folder: Path) -> None:
        """Write the state to resume from, then the model; each file appears whole or not at all.

        Raises:
            Diverged: a weight is not finite; what was saved before stays then.
        """
        progress, advice = Progress(self.step, self.best), self.watch.advice()
        learner, origin = self._learner(), self._origin()
        save_state(folder, learner, self._left_out, origin=origin, progress=progress, advice=advice)
        self._save_model(folder / MODEL_FILE)
        keep_checkpoint(folder, self.step, self.config.training.keep_checkpoints)

    def save_best(self, folder: Path) -> None:
        """Write the model beside the run's last one, as that of the best validation."""
        self._save_model(folder / BEST_FILE)

    def load(self, folder: Path) -> None:
        """Go on where `save` left off.

        Raises:
            InputError: a state that is damaged, of another architecture, or of a run that began with something else.
        """
        group = left_out_groups(self.train_frames.clip_starts, GROUPS)
        progress, self._left_out = load_state(folder, self._learner(), self._origin(), group)
        if self.config.training.steps:
            check_trainable(self.model.head, folder)
        self.step, self.best = progress.step, progress.best

    def _save_model(self, path: Path) -> None:
        with self._result():
            save_model(path, self.model, stored=self.config.training.stored, steps=self.step)

    def _learner(self) -> Learner:
        return Learner(self.model, self.optimizer, self._average)

    def _origin(self) -> Origin:
        marks = {"training": self.train_frames.mark, "validation": self.validation_frames.mark}
        return Origin(self.init_mark, marks, self.frames_a_step, self.config.training.init)
