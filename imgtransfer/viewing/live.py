"""A garment that is predicted while its body is changed by hand."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from torch import Tensor

from fusion import BodySdf, DecodedMaps, FusionInputs, InitialWeights, MovingSurface, fuse
from fusion.parallel import one_torch_thread
from imgtransfer.bodies import AnnyConfig, AnnyShape, SkinnedBody, load_body
from imgtransfer.bodies.smpl import INDEX
from imgtransfer.data.canonical import RootFrames
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Body, Skeleton, Template
from imgtransfer.dressing.hanging import hanging_garment
from imgtransfer.garments import DressConfig, SkirtConfig, TrousersConfig, TShirtConfig
from imgtransfer.garments.refit import carried
from imgtransfer.network.model import Predictor, TransferModel
from imgtransfer.network.prediction import Prediction, ShownFrames
from imgtransfer.simulation.quality import push_out
from imgtransfer.training.checkpoint import load_model
from imgtransfer.viewing.frame import Dress, Frame, MapImages
from render import InputError, Mesh, Option, decode_normals

GARMENTS: dict[str, type[TShirtConfig | DressConfig | TrousersConfig | SkirtConfig]] = {
    "tshirt": TShirtConfig,
    "dress": DressConfig,
    "trousers": TrousersConfig,
    "skirt": SkirtConfig,
}
# A network that is shown the body at earlier times sees it standing still: two like frames, this far apart.
_FPS = 5.0

#: What the pose is set by: joints of SMPL, and the axis and sign of their turn from arms to the sides.
TURNS: dict[str, tuple[tuple[str, tuple[float, float, float]], ...]] = {
    "arms up": (("left_shoulder", (0.0, 0.0, 1.0)), ("right_shoulder", (0.0, 0.0, -1.0))),
    "elbows": (("left_elbow", (0.0, -1.0, 0.0)), ("right_elbow", (0.0, 1.0, 0.0))),
    "left leg forward": (("left_hip", (-1.0, 0.0, 0.0)),),
    "right leg forward": (("right_hip", (-1.0, 0.0, 0.0)),),
    "knees": (("left_knee", (1.0, 0.0, 0.0)), ("right_knee", (1.0, 0.0, 0.0))),
    "lean forward": (("spine1", (0.5, 0.0, 0.0)), ("spine2", (0.5, 0.0, 0.0))),
    "twist": (("spine1", (0.0, 0.5, 0.0)), ("spine2", (0.0, 0.5, 0.0))),
}


@dataclass(frozen=True, eq=False)
class LiveMotion:
    """One frame, predicted.

    Args:
        title: what the page calls it. dress: garment and body. now: the frame.
        milliseconds: how long the prediction took, and the fusion; 0 for one that was not asked for.
    """

    title: str
    dress: Dress
    now: Frame
    milliseconds: tuple[float, float]
    n_frames: int = 1

    def frame(self, number: int) -> Frame:
        """See `Motion`."""
        return self.now


class LiveModel:
    """Predicts garments on the shipped body, in any shape and pose.

    Args:
        path: of the model. It is read when the first garment is asked for.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def check(self) -> None:
        """Read the model.

        Raises:
            InputError: it cannot be read, or is of one garment only.
        """
        _ = self._model

    @cached_property
    def _model(self) -> TransferModel:
        model = load_model(self._path)
        if not model.general:
            raise InputError(
                f"{Option('model')} {self._path}: this model is for one garment; one for any garment is wanted, such "
                "as general, the package's own"
            )
        return model.eval()

    def worn(self, kind: str, shape: AnnyShape) -> Worn:
        """A garment of `GARMENTS` on the body in a shape: what the poses have in common.

        Raises:
            InputError: a model that cannot be read, or is of one garment only.
        """
        return Worn(self._model, kind, shape)


class Worn:
    """A garment on a body, ready to be predicted in any pose.

    Args:
        model: a general one. kind: of `GARMENTS`. shape: of the body.
    """

    def __init__(self, model: TransferModel, kind: str, shape: AnnyShape) -> None:
        self._body = load_body(shape)
        self._template = _on(self._body, kind)
        self._title = f"live: {kind}"
        self._predictor: Predictor = model.predictor(self._clip(np.zeros((1, 22, 3))))
        rest = Mesh(self._body.rest.astype(np.float64), self._body.faces, "body")
        self._weights = InitialWeights(self._predictor.imager, self._template)
        self.dress = Dress(self._template, rest, lambda: self._predictor.imager)

    @one_torch_thread()  # one frame is too little to share out: two threads wait for each other on a busy machine
    def posed(self, degrees: dict[str, float], *, fused: bool) -> LiveMotion:
        """The garment predicted for a pose.

        Args:
            degrees: by the names of `TURNS`. fused: whether the maps are fused, or only read.
        """
        clip = self._clip(np.repeat(pose_of(degrees), 2, axis=0))
        start = time.perf_counter()
        prediction = self._predictor.predicted(_last(self._predictor.shown(clip)))
        vertices = self._weights(prediction.imager.sample(prediction.metres())).numpy()
        predicted = time.perf_counter()
        if fused:
            vertices = self._fused(prediction, clip)
        took = predicted - start, (time.perf_counter() - predicted) if fused else 0.0
        frame = Frame(
            prediction.frames.to_world(vertices)[0], clip.body.vertices[-1], None, _images(prediction)
        )
        return LiveMotion(self._title, self.dress, frame, (1000 * took[0], 1000 * took[1]))

    def _fused(self, prediction: Prediction, clip: Clip) -> np.ndarray:
        maps = DecodedMaps(prediction.metres(), decode_normals(prediction.normals))
        body = MovingSurface(prediction.frames.to_canonical(clip.body.vertices[-1:]), clip.body.faces)
        inputs = FusionInputs(
            maps=maps,
            body=body,
            rest=prediction.rest_vertices,
            contact_offset_m=prediction.contact_offset_m,
        )
        return fuse(prediction.imager, inputs).vertices

    def _clip(self, poses: np.ndarray) -> Clip:
        """The body in poses (T, 22, 3)."""
        body: SkinnedBody = self._body
        trans = np.repeat(body.joints_rest[:1], len(poses), axis=0)
        posed = body.pose(poses, trans)
        skeleton = Skeleton(
            poses=poses.astype(np.float32),
            trans=(posed.joints[:, 0] - body.joints_rest[0]).astype(np.float32),
            joints_rest=body.joints_rest.astype(np.float32),
            parents=body.parents,
        )
        template = Template(self._template.vertices.astype(np.float32), self._template.faces)
        worn = Body(body.rest, body.faces, posed.vertices)
        return Clip(template, None, worn, _FPS, skeleton, name="live")


def pose_of(degrees: dict[str, float]) -> np.ndarray:
    """(1, 22, 3) axis-angles, radians, of a pose by the names of `TURNS`; what is not named is 0, as in the T-pose."""
    poses = np.zeros((1, len(INDEX), 3))
    for name, angle in degrees.items():
        for joint, axis in TURNS[name]:
            poses[0, INDEX[joint]] += np.radians(angle) * np.array(axis)
    return poses


def _on(body: SkinnedBody, kind: str) -> Mesh:
    """The garment as it hangs on the default body, carried to another shape of that: in milliseconds, where making it
    for the shape takes seconds.
    """
    hangs = hanging_garment(GARMENTS[kind](detail="small"), AnnyConfig())
    moved = carried(hangs, load_body().rest, body.rest).astype(np.float32)
    sdf = BodySdf(body.faces, len(body.rest))
    sdf.update(body.rest)
    return Mesh(push_out(moved, sdf)[0].astype(np.float64), hangs.faces, kind)


def _last(shown: ShownFrames) -> ShownFrames:
    """Only the last frame."""

    def last(values: Tensor | None) -> Tensor | None:
        return None if values is None else values[-1:]

    frames = RootFrames(shown.frames.rotation[-1:], shown.frames.translation[-1:])
    return ShownFrames(
        frames, shown.fps, shown.body[-1:], last(shown.earlier), last(shown.up), last(shown.skinned)
    )


def _images(prediction: Prediction) -> Callable[[], MapImages]:
    def images() -> MapImages:
        imager = prediction.imager
        return MapImages(
            tuple(camera.name for camera in imager.cameras),
            prediction.positions[0].numpy(),
            prediction.normals[0].numpy(),
            imager.mask.numpy(),
        )

    return images
