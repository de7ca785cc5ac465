"""The trained thing: both transfer networks, with the garment and the encoding that they were made for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from imgtransfer.data.canonical import RootFrames, root_frames
from imgtransfer.data.clip import Clip
from imgtransfer.network.config import MapsConfig, NetworkConfig
from imgtransfer.network.history import History
from imgtransfer.network.kernel_head import KernelHead, Values, corrected
from imgtransfer.network.laid_out import garment_imager, layouts_of
from imgtransfer.network.local_transfer import LocalTransferNet
from imgtransfer.network.maps import BodyImager, BodyMaps, ImagePair, covered, metric_maps
from imgtransfer.network.mirror import Garment, Mirror
from imgtransfer.network.pair import encoded, transferred
from imgtransfer.network.prediction import Prediction, ShownFrames
from imgtransfer.network.reading import Version, read_frames
from imgtransfer.network.residuals import averaged_images, corrected_images
from imgtransfer.network.shapes import as_it_hangs, check_clip, same_faces, same_template
from imgtransfer.network.skinned import skinned_frames
from imgtransfer.network.transfer import TransferNet, build_transfer_net
from render import InputError, Mesh, PositionBox, encode_normals
from render.threads import one_blas_thread

FRAMES_AT_ONCE = 16


class TransferModel(nn.Module):
    """f_p and f_n of equation 2 for one garment, or for any (`general`).

    Args:
        maps: how meshes become images.
        network: sizes and switches of both networks.
        template: the garment.
        box: of the garment's positions.
        body: the rest body that wears the template. With it the model knows clips of the same garment on other
            shapes of this body: all are imaged through this template and this body, whose projections show the same
            points of either in every shape. None: the model is for the template's shape alone.
        general: whether the networks dress any garment on any body: clips are then imaged through their own
            (`dressed`), and `template` and `body` are only the first that the networks were trained on.
        networks: both, made already; new ones if None.
        architecture: of another model, whose encoder's weights are to follow; None reads a pretrained one's.
        layouts: of template and body, with `maps.views: uv`; xatlas makes them if None.

    Raises:
        InputError: the map size does not suit the encoder's patch, or a pretrained encoder or xatlas cannot be had.
    """

    mask: Tensor
    garment_positions: Tensor
    garment_normals: Tensor

    def __init__(
        self,
        *,
        maps: MapsConfig,
        network: NetworkConfig,
        template: Mesh,
        box: PositionBox,
        body: Mesh | None = None,
        general: bool = False,
        networks: tuple[LocalTransferNet | TransferNet, LocalTransferNet | TransferNet] | None = None,
        architecture: dict[str, Any] | None = None,
        layouts: tuple[Mesh, Mesh] | None = None,
    ) -> None:
        super().__init__()
        if general and network.body != "local":
            raise InputError("network.body is images, whose networks know one garment; several need local")
        self.body, self.general, self.asked = body, general, maps
        self.source = "the model"  # what messages call it
        self.mirrored_average = False  # whether predictions are means with those of the mirrored scene
        # Metres off the skin at which the cloth of its training clips rests; None: unknown.
        self.contact_offset_m: float | None = None
        self.layouts = layouts or layouts_of(maps, template, body)
        self.imager = garment_imager(maps, template, self.layouts)
        # With the elevations that were chosen for the template, so that what is stored never chooses again.
        views = tuple(camera.name for camera in self.imager.cameras if camera.layer == 0)
        self.maps, self.network, self.box = maps.model_copy(update={"views": views}), network, box
        made = networks or tuple(
            build_transfer_net(network, maps.size, len(self.imager.cameras), architecture) for _ in range(2)
        )
        self.position_net, self.normal_net = made
        self.head: KernelHead | None = None  # until it is fitted or read
        vertices = torch.as_tensor(template.vertices, dtype=torch.float32)[None]
        garment = ImagePair.encode(*metric_maps(self.imager, vertices), self.imager.mask, box)
        # Buffers, so that they move with the networks; made again from the template, so not stored.
        self.register_buffer("mask", self.imager.mask, persistent=False)
        self.register_buffer("garment_positions", garment.positions, persistent=False)
        self.register_buffer("garment_normals", garment.normals, persistent=False)

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        return self.garment_positions.device

    @property
    def architecture(self) -> dict[str, Any] | None:
        """Of the pretrained encoder; None where the encoder was trained from scratch."""
        network = self.position_net
        return network.encoder.architecture if isinstance(network, TransferNet) else None

    def garment(self) -> ImagePair:
        """The template's images, (1, S, H, W, 3)."""
        return ImagePair(self.garment_positions, self.garment_normals)

    def dressed(self, clip: Clip) -> TransferModel:
        """The model for a clip's garment and body: itself, or if it is general, its networks with those of the clip.

        Its position box is the general model's, that of all garments trained on; nothing is cut off outside.
        """
        if not self.general:
            return self
        template = Mesh(clip.template.vertices.astype(np.float64), clip.template.faces, clip.name)
        worn = TransferModel(
            maps=self.asked,
            network=self.network,
            template=template,
            box=self.box,
            body=Mesh(clip.body.rest.astype(np.float64), clip.body.faces, clip.name),
            networks=(self.position_net, self.normal_net),
        )
        worn.source, worn.mirrored_average = self.source, self.mirrored_average
        worn.contact_offset_m = self.contact_offset_m
        return worn.train(self.training).to(self.device)

    def body_imager(self, *clips: Clip) -> BodyImager:
        """Images the bodies of clips as this model needs it.

        Args:
            clips: one a shape, in the order in which the imager counts shapes; their body faces are the same.

        Raises:
            InputError: a clip's garment is not the model's.
        """
        for clip in clips:
            self.check_garment(clip)
        body = self.body
        if body is None or not same_faces(clips[0].body.faces, body.faces):
            body = Mesh(clips[0].body.rest, clips[0].body.faces, clips[0].name)
        return BodyImager(
            self.imager,
            body,
            layout=None if self.layouts is None else self.layouts[1],
            shapes=[(clip.template.vertices, clip.body.rest) for clip in clips],
            box=self.box,
            config=self.network,
            device=self.device,
        )

    def check_garment(self, clip: Clip) -> None:
        """Raise InputError unless the clip's garment is its own, in any shape (`check_clip`), or this is general."""
        if self.general:
            return
        check_clip(clip, self.imager.mesh, self.body)

    def forward(
        self,
        body: BodyMaps,
        *,
        garment: Garment | None = None,
        tokens: tuple[Tensor, Tensor] | None = None,
    ) -> ImagePair:
        """Images of the deformed garment.

        Args:
            body: maps of B posed bodies.
            garment: the template as the networks see it: its images, if not the model's own (a mirrored garment), or
                with `body: local` what `BodyImager.view` tells of it, which is needed.
            tokens: `encode_garment(garment)` of an earlier call; one for all frames, or one a frame, as of `garment`.

        Returns:
            encoded images, (B, S, H, W, 3) each; values off the silhouette mean nothing, normals are not yet
            unit.
        """
        given = transferred((self.position_net, self.normal_net), body, garment or self.garment(), tokens)
        return ImagePair(*given) if body.guess is None else corrected_images(body.guess, given, self.box)

    def guessed(self, body: BodyMaps, versions: Sequence[Version], values: Values | None = None) -> BodyMaps:
        """Maps of posed bodies with the head's first guess, if there is one; `values` of `KernelHead.forward`."""
        if self.head is None:
            return body
        networks = (self.position_net, self.normal_net)
        read = read_frames(networks, versions, body.local) if self.head.reads else ()
        return corrected(self.head, body, read=read, values=values, mirrored=self.mirrored_average)

    def calibrate(self, typical: Sequence[tuple[BodyMaps, Garment]]) -> None:
        """Let parts that need it take their statistics from maps of typical frames, of each outfit with its template.

        Networks that are shown the body's images know one garment, and take the first.
        """
        body, _ = typical[0]
        for network, image in (
            (self.position_net, body.images.positions),
            (self.normal_net, body.images.normals),
        ):
            if isinstance(network, LocalTransferNet):
                network.calibrate([covered(maps, garment) for maps, garment in typical])
            elif network.pose_code is not None:
                network.pose_code.calibrate(image)

    def encode_garment(
        self, garment: Garment, hidden: tuple[Tensor, Tensor] | None = None
    ) -> tuple[Tensor, Tensor]:
        """The template's tokens of both networks, to be given to `forward`; `hidden` as of `TrunkCache.template`."""
        return encoded((self.position_net, self.normal_net), garment, hidden)

    def versions(self, garment: Garment, mirror: Mirror | None) -> list[Version]:
        """A template as the networks see it, and with `mirror` mirrored, each with its tokens."""
        seen = [garment] if mirror is None else [garment, mirror.seen(garment)]
        return [(version, self.encode_garment(version)) for version in seen]

    def averaged(self, body: BodyMaps, mirror: Mirror, versions: Sequence[Version]) -> ImagePair:
        """Images as `forward` gives them, averaged with those of the mirrored scene, mirrored back.

        The mirrored scene's first guess is the first guess mirrored, so its residual alone is mirrored back.

        Args:
            body: maps of B posed bodies.
            mirror: of this garment and body.
            versions: of the garment.

        Returns:
            encoded images: means of positions, and means of unit normals, made unit. Values off the silhouette mean
            nothing.
        """
        networks = (self.position_net, self.normal_net)
        plain, mirrored = (
            transferred(networks, maps, garment, tokens)
            for maps, (garment, tokens) in zip((body, mirror.shown(body)), versions, strict=True)
        )
        if body.guess is None:
            return mirror.average(ImagePair(*plain), ImagePair(*mirrored))
        return averaged_images(body.guess, plain, mirror.residuals(mirrored), self.box)

    def seen(self, imager: BodyImager) -> Garment:
        """The template as the networks see it on an imager's body: its first shape's view, or its images."""
        return self.garment() if imager.view is None else imager.view.template()

    def predictor(self, clip: Clip, *, hangs: np.ndarray | None = None) -> Predictor:
        """Predicts frames of clips with this garment and body.

        Args:
            clip: any frames of a body in motion and the model's garment, in the shape of that body.
            hangs: see `as_it_hangs`.

        Raises:
            InputError: the clip's garment is not the model's, or `hangs` for a model that knows one template.
        """
        return Predictor(self, clip, hangs)

    @one_blas_thread()
    def predict(self, clip: Clip, progress: Callable[[Iterable[int]], Iterable[int]] = iter) -> Prediction:
        """Predict the maps of every frame; the garment's own motion is not looked at.

        Args:
            clip: a body in motion and the model's garment, in the shape of that body.
            progress: wraps the iteration over the first frames of batches, such as tqdm.

        Raises:
            InputError: the clip's garment is not the model's.
        """
        predictor = self.predictor(clip)
        starts = progress(range(0, clip.n_frames, FRAMES_AT_ONCE))
        parts = [predictor(clip.slice(slice(start, start + FRAMES_AT_ONCE))) for start in starts]
        return replace(
            parts[0],
            positions=torch.cat([part.positions for part in parts]),
            normals=torch.cat([part.normals for part in parts]),
            frames=RootFrames(
                np.concatenate([part.frames.rotation for part in parts]),
                np.concatenate([part.frames.translation for part in parts]),
            ),
        )


class Predictor:
    """Predicts some frames at a time; what they have in common is made once.

    Args:
        model: with its weights.
        clip: any frames of the clip, or of another of the same garment and body.
        hangs: see `as_it_hangs`.

    Raises:
        InputError: the clip's garment is not the model's, or `hangs` for a model that knows one template.
    """

    @torch.no_grad()
    def __init__(self, model: TransferModel, clip: Clip, hangs: np.ndarray | None = None) -> None:
        shown = clip if hangs is None else as_it_hangs(clip, hangs, model.general, model.source)
        self._model = model = model.dressed(shown)
        self._body = model.body_imager(shown)
        average = model.mirrored_average
        self._mirror = Mirror(model.imager, model.mask, self._body.mask, model.box) if average else None
        self._versions = model.versions(model.seen(self._body), self._mirror)
        self._history = None if self._body.view is None else History(model.network.history_s, clip.fps)
        of_another_shape = not same_template(clip, model.imager.mesh)
        self.imager = model.imager  # of the garment's template
        self.rest_vertices = clip.template.vertices.astype(np.float64) if of_another_shape else None

    def __call__(self, clip: Clip) -> Prediction:
        """The maps of all frames of `clip`, in one batch (about `FRAMES_AT_ONCE` are wanted); calls as for `shown`."""
        return self.predicted(self.shown(clip))

    @torch.no_grad()
    def shown(self, clip: Clip) -> ShownFrames:
        """What the maps of all frames of `clip` follow from.

        Where the network is shown the body at earlier times, calls must follow each other as the frames do: each goes
        on where the last ended.
        """
        frames, device = root_frames(clip, self._model.maps.root), self._model.device
        body = torch.from_numpy(frames.to_canonical(clip.body.vertices)).to(device)
        if self._history is None:
            skinned = skinned_frames(clip, frames, self._model.network, device)
            return ShownFrames(frames, clip.fps, body, skinned=skinned)
        assert self._body.view is not None
        samples = self._body.view.samples(torch.from_numpy(clip.body.vertices.astype(np.float32)).to(device))
        earlier, up = (torch.from_numpy(of).to(device) for of in self._history(samples.cpu().numpy(), frames))
        return ShownFrames(frames, clip.fps, body, earlier, up)

    @torch.no_grad()
    def predicted(self, shown: ShownFrames) -> Prediction:
        """The maps of some frames, in one batch; by any thread."""
        model = self._model
        body = self._body(shown.body, earlier=shown.earlier, up=shown.up, skinned=shown.skinned)
        images = self._images(model.guessed(body, self._versions))
        if not (images.positions.isfinite().all() and images.normals.isfinite().all()):
            raise InputError(
                f"{model.source}: predicts values that are not finite; the file is damaged, or the training diverged"
            )
        kept = model.mask[..., None]
        unit = nn.functional.normalize(images.normals * 2 - 1, dim=-1)
        positions, normals = (images.positions * kept).cpu(), (encode_normals(unit) * kept).cpu()
        about = model.imager, model.box, shown.fps, self.rest_vertices, model.contact_offset_m
        return Prediction(positions, normals, shown.frames, *about)

    def _images(self, body: BodyMaps) -> ImagePair:
        if self._mirror is None:
            images: ImagePair = self._model(body, garment=self._versions[0][0], tokens=self._versions[0][1])
            return images
        return self._model.averaged(body, self._mirror, self._versions)
