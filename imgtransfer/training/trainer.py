"""One training run in memory: data, both networks, optimiser, the step it is at."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path

import torch
from torch import Tensor, nn

from imgtransfer.data.source import clip_refs
from imgtransfer.network import map_errors, masked_l1
from imgtransfer.network.kernel_head import LeftOut
from imgtransfer.network.local_view import TemplateView
from imgtransfer.network.maps import BodyMaps, ImagePair, metric_maps
from imgtransfer.network.memory import check_training_memory
from imgtransfer.network.mirror import of_frames
from imgtransfer.network.trunk_cache import TrunkCache, trunk_cache
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
from imgtransfer.training.outfits import Outfit, Outfits
from imgtransfer.training.patch_losses import PatchLosses
from imgtransfer.training.precision import Workload, bfloat16_ratio, choose_precision
from imgtransfer.training.prepared import mark_of
from imgtransfer.training.sampler import Frames
from imgtransfer.training.start import new_model, trained_model
from render import InputError, Option, decode_normals

VALIDATION_BATCH = 16
CALIBRATION_FRAMES, CALIBRATION_OUTFITS = 64, 12


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
            check_training_memory(
                config.network,
                config.maps,
                batch_frames=options.batch_frames,
                averaged=options.ema is not None,
            )
        # Seeded after the data and before the weights: the same seed gives the same run on any amount of
        # data.
        torch.manual_seed(options.seed)
        if options.init is None:
            self.model = new_model(config, self.train_frames).to(self.device)
        else:
            self.model = trained_model(config, self.train_frames, options.init).to(self.device)
        self.init_mark = None if options.init is None else fingerprint(options.init)
        self._left_out: LeftOut | None = None
        self._trunks: TrunkCache | None = None
        frames = (self.train_frames, self.validation_frames)
        self._outfits = {id(some): Outfits(self.model, some, mirrored=options.mirror) for some in frames}
        for clip in chain(*self.validation_frames.outfits):
            self.model.check_garment(clip)  # now: one that is not the model's must not stop the run later
        self.mirror = self._outfits[id(self.train_frames)][0].mirror
        self._patch_losses: PatchLosses | None = None
        if config.network.body == "local":
            train, of = self.train_frames, self._outfits[id(self.train_frames)]
            self._patch_losses = PatchLosses(self.model, train, of, partial(self.batch, train))
        if options.init is None:
            self._calibrate()
        self.model.mirrored_average = options.mirror
        self.order = self.train_frames.order(options.batch_frames, options.seed)
        self.optimizer = build_optimizer(self.model, options)
        self._average = None if options.ema is None else WeightAverage(self.model, options.ema)
        self.step = 0

    def fit_head(self) -> None:
        """Fit what corrects the first guess, where the configuration wants that; before the first step.

        Where the run begins with a trained model, it is fitted to what that model's networks leave: they add up.

        Raises:
            InputError: damaged data.
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
        self.model.head, self._left_out = fit_head(
            self.model,
            self.train_frames,
            self._batch_of_init,
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
        index = self.order.frames(self.step)
        mirrored = self.order.coins(self.step).to(self.device) if options.mirror else None
        self.model.train()
        if self.config.network.dropout:
            torch.manual_seed(self.order.step_seed(self.step))  # a resumed run draws the same
        self.optimizer.zero_grad()
        losses = {"position_loss": 0.0, "normal_loss": 0.0}
        for number, places in self.train_frames.by_outfit(index):
            coins = None if mirrored is None else mirrored[places.to(self.device)]
            some = self._losses(number, index[places], coins)
            fraction = len(places) / len(index)
            # The networks share no weight, so the sum trains each by its own loss (equation 3).
            (fraction * (some[0] + some[1])).backward()
            for key, loss in zip(losses, some, strict=True):
                losses[key] += fraction * loss.item()
        if options.gradient_clip is not None:
            for network in (self.model.position_net, self.model.normal_net):
                nn.utils.clip_grad_norm_(network.parameters(), options.gradient_clip)
        self.optimizer.step()
        self.step += 1
        if self._average is not None:
            self._average.update(self.step)
        return losses | {"learning_rate": rate}

    def cache_trunks(self, folder: Path) -> None:
        """Compute what is frozen of pretrained encoders once a frame, and keep it in `folder` while the run lasts."""
        options, shown = self.config.training, self._outfits[id(self.train_frames)][0].shown
        with self._autocast():
            self._trunks = trunk_cache(
                self.model,
                shown,
                frames=len(self.train_frames),
                mirrored=options.mirror,
                folder=folder,
                limit=options.trunk_cache_gb * 1e9,
            )

    def rehearse(self) -> None:
        """What takes the time of the next step, forward and backward; it changes nothing."""
        index = self.order.frames(self.step)
        mirrored = self.order.coins(self.step).to(self.device) if self.config.training.mirror else None
        self.model.train()
        for number, places in self.train_frames.by_outfit(index):
            coins = None if mirrored is None else mirrored[places.to(self.device)]
            sum(self._losses(number, index[places], coins)).backward()  # type: ignore[union-attr]
        self.optimizer.zero_grad()

    def _losses(self, number: int, index: Tensor, mirrored: Tensor | None) -> tuple[Tensor, Tensor]:
        """Both losses of training frames `index` (B,) of outfit `number`, those where `mirrored` (B,) mirrored."""
        if self._patch_losses is not None:
            with self._autocast():
                return self._patch_losses(number, index, mirrored)
        outfit = self._outfits[id(self.train_frames)][number]
        body, truth = self.batch(self.train_frames, index)
        mask = outfit.model.mask
        if outfit.mirror is not None:
            assert mirrored is not None
            body, truth = outfit.mirror.body(body, mirrored), outfit.mirror.garment(truth, mirrored)
            mask = outfit.mirror.masks(mirrored)
        with self._autocast():
            hidden = None
            if self._trunks is not None:
                hidden, body = self._trunks.template, self._trunks.body(body, index, mirrored)
            garment, tokens = outfit.shown, outfit.model.encode_garment(outfit.shown, hidden)
            if mirrored is not None:
                garment, tokens = of_frames((garment, tokens), mirrored)
            predicted = outfit.model(body, garment=garment, tokens=tokens)
        return (
            masked_l1(predicted.positions, truth.positions, mask),
            masked_l1(predicted.normals, truth.normals, mask),
        )

    def prepare(self, folder: Path) -> None:
        """Make what local networks are shown of all training frames, in a file in the run's folder.

        After the head is fitted or read, and before the first step.

        Raises:
            InputError: too little room on the disk, or damaged data.
        """
        if self._patch_losses is None or self.config.training.steps <= self.step:
            return
        config = self.config
        texts = [
            config.data.model_dump_json(),
            config.maps.model_dump_json(),
            config.network.model_dump_json(),
        ]
        meshes = [clip.template.vertices for clip in chain(*self.train_frames.outfits)]
        head = [] if self.model.head is None else [self.model.head.weights.cpu().numpy()]
        mark = mark_of(texts, [self.train_frames.clip_starts, *meshes, *head])
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
        body = self.model.guessed(body, values)
        positions, normals = metric_maps(outfit.model.imager, garment.to(self.device))
        return body, ImagePair.encode(positions, normals, outfit.model.mask, outfit.model.box)

    @torch.no_grad()
    def _batch_of_init(self, index: Tensor) -> tuple[BodyMaps, ImagePair]:
        """`batch` of training frames, with what the networks that the run begins with predict as the first guess."""
        body, truth = self.batch(self.train_frames, index)
        if self.config.training.init is None:
            return body, truth  # the networks begin with 0
        outfit = self._outfit(self.train_frames, index)
        assert body.guess is not None  # the configuration sees to it
        self.model.eval()
        images = self._predicted(outfit, body)
        guess = replace(
            body.guess,
            positions=outfit.model.box.decode(images.positions),
            normals=decode_normals(images.normals),
        )
        return replace(body, guess=guess), truth

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
        for together in index.split(VALIDATION_BATCH):
            for _, places in self.validation_frames.by_outfit(together):
                part = together[places]
                for key, value in self._errors(part).items():
                    sums[key] = sums.get(key, 0.0) + value * len(part) / len(index)
        return sums

    def _errors(self, index: Tensor) -> dict[str, float]:
        """The same of validation frames `index` (B,) of one outfit."""
        outfit = self._outfit(self.validation_frames, index)
        mask, box = outfit.model.mask, outfit.model.box
        body, truth = self.batch(self.validation_frames, index)
        with self._autocast(), self._result():
            predicted = self._predicted(outfit, body)
        errors = map_errors(predicted, truth, mask, box)
        if body.guess is not None:
            guess = ImagePair.encode(body.guess.positions, body.guess.normals, mask, box)
            errors |= {f"guess_{key}": value for key, value in map_errors(guess, truth, mask, box).items()}
        return errors

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

    def _frames(self, choice: ClipChoice) -> Frames:
        data = self.config.data
        refs = [
            ref
            for source in data.sources
            for ref in clip_refs(source, split=choice.split, names=choice.names, exclude=choice.exclude)
        ]
        readers, root = [ref.reader() for ref in refs], self.config.maps.root
        history = self.config.network.history_s
        several = self.config.network.body == "local"
        limit, skins = int(data.cache_gb * 1e9), self.config.network.skins
        return Frames(readers, root, limit, several=several, history_s=history, skins=skins)

    def _outfit(self, frames: Frames, index: Tensor) -> Outfit:
        """That of frames `index` (B,)."""
        ((number, _),) = frames.by_outfit(index)
        return self._outfits[id(frames)][number]

    def _predicted(self, outfit: Outfit, body: BodyMaps) -> ImagePair:
        """Images for maps of validation frames."""
        if outfit.mirror is None:
            images: ImagePair = outfit.model(body, garment=outfit.garment)
            return images
        versions = outfit.model.versions(outfit.garment, outfit.mirror)
        return outfit.model.averaged(body, outfit.mirror, versions)

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
