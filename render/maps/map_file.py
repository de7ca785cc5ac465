"""Maps, with all that someone else needs to turn them into a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from render.cameras import Camera
from render.errors import InputError
from render.limits import FARTHEST, check_contact_offset, check_rate, check_rotations
from render.maps.encoding import PositionBox
from render.maps.imager import TemplateImager
from render.maps.layout import check_layout
from render.mesh.mesh import Mesh, check_finite

FORMAT, FORMAT_VERSION = "imgtransfer-maps", 3
HEAVIEST = 1e6  # of a pixel's confidence, where 1 is as usual
# Version 1 has no layers, depth or confidence, version 2 no rest_vertices.
# 4 are those with a layout, which a reader of 3 would take for the template's silhouette.
READABLE_VERSIONS = ("1", "2", "3", "4")
_OF_A_LAYOUT = ("layout_vertices", "layout_faces")
OPTIONAL = {
    "position",
    "normal",
    "layers",
    "confidence",
    "depth",
    "rest_vertices",
    "contact_offset_m",
    *_OF_A_LAYOUT,
}
BY_FRAME = ("position", "normal", "confidence", "rotation", "translation")


class Maps(Protocol):
    """Maps of T frames that are taken some frames at a time: a `MapFile`, or a file of which no more is read."""

    @property
    def n_frames(self) -> int:
        """T."""
        ...

    def parts(self, count: int) -> Iterator[MapFile]:
        """All frames in order, `count` at a time; the last part may be shorter."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class MapFile:
    """Encoded maps of T frames from S views of H × W pixels, and the template and frames they belong to.

    Args:
        position: (T, S, H, W, 3) float32, encoded by the box, background 0; None if there are normals only.
        normal: (T, S, H, W, 3) float32, (n + 1) / 2, background 0; None if there are positions only.
        mask: (S, H, W) bool, the template's silhouette.
        box_lo, box_hi: (3,) float64, metres, the position box.
        views: S names.
        view_matrices, projection_matrices: (S, 4, 4) float64, as in `Camera`.
        template_vertices: (N, 3) float64, metres; template_faces: (F, 3) int64.
        rotation: (T, 3, 3) float64 and translation: (T, 3) float64, metres: the canonical frame,
            x = R x' + t.
        fps: frames per second.
        layers: (S,) int64, as in `Camera`; all 0 if None.
        confidence: (T, S, H, W) float32, at least 0, weights of the pixels: 1 as usual, 0 to ignore one; None
            if all count alike.
        depth: (S, H, W) float32, metres along each camera's viewing axis to the template, background 0; None
            if unknown. Nothing is computed from it.
        rest_vertices: (N, 3) float64, metres, the garment as it lies on the body that these frames are of, where
            that is another shape than the template's; None if it is the template.
        layout_vertices: (U, 3) float64, metres, and layout_faces: (F, 3) int64: the template laid out flat, where
            the cameras look at that and not at the template; both None otherwise.
        contact_offset_m: metres off the skin at which the cloth rests where it touches; None if unknown.

    Raises:
        InputError: a shape that does not fit the others, values that are not finite or cannot be meant
            (`render.limits`), or rotations that are none.
    """

    position: np.ndarray | None
    normal: np.ndarray | None
    mask: np.ndarray
    box_lo: np.ndarray
    box_hi: np.ndarray
    views: tuple[str, ...]
    view_matrices: np.ndarray
    projection_matrices: np.ndarray
    template_vertices: np.ndarray
    template_faces: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    fps: float
    layers: np.ndarray | None = None
    confidence: np.ndarray | None = None
    depth: np.ndarray | None = None
    rest_vertices: np.ndarray | None = None
    layout_vertices: np.ndarray | None = None
    layout_faces: np.ndarray | None = None
    contact_offset_m: float | None = None

    def __post_init__(self) -> None:
        maps = self.position if self.position is not None else self.normal
        if maps is None:
            raise InputError("a map file needs position or normal maps, found neither")
        frames, views = np.shape(maps)[0] if np.ndim(maps) else 0, len(self.views)
        size = np.shape(self.mask)[1:]
        vertices = np.shape(self.template_vertices)[:1]
        if self.layers is None:
            object.__setattr__(self, "layers", np.zeros(views, np.int64))
        expected: dict[str, tuple[tuple[int, ...], type]] = {
            "position": ((frames, views, *size, 3), np.float32),
            "normal": ((frames, views, *size, 3), np.float32),
            "mask": ((views, *size), np.bool_),
            "box_lo": ((3,), np.float64),
            "box_hi": ((3,), np.float64),
            "view_matrices": ((views, 4, 4), np.float64),
            "projection_matrices": ((views, 4, 4), np.float64),
            "template_vertices": ((*vertices, 3), np.float64),
            "rotation": ((frames, 3, 3), np.float64),
            "translation": ((frames, 3), np.float64),
            "layers": ((views,), np.int64),
            "confidence": ((frames, views, *size), np.float32),
            "depth": ((views, *size), np.float32),
            "rest_vertices": ((*vertices, 3), np.float64),
        }
        if len(size) != 2 or frames == 0:
            raise InputError(
                f"maps: one frame or more and masks (S, H, W) are needed; found {frames} frames, "
                f"mask {np.shape(self.mask)}"
            )
        check_rate(self.fps, "maps")
        if self.contact_offset_m is not None:
            check_contact_offset(self.contact_offset_m, "maps")
        for name, (shape, dtype) in expected.items():
            if getattr(self, name) is not None:
                given = np.asarray(getattr(self, name))
                if given.dtype.kind not in "fiub":
                    raise InputError(f"maps: {name} must be numbers, found {given.dtype}")
                array: np.ndarray = given.astype(dtype, copy=False)
                if array.shape != shape or not np.isfinite(array).all():
                    raise InputError(f"maps: {name} must be finite, of shape {shape}; found {array.shape}")
                object.__setattr__(self, name, array)
        check_rotations(self.rotation, "maps: rotation")
        self._check_sizes()
        object.__setattr__(self, "fps", float(self.fps))
        object.__setattr__(self, "views", tuple(str(view) for view in self.views))
        object.__setattr__(self, "template_faces", self.template.faces)  # checks them
        if self.layout is not None:
            check_layout(self.layout, self.template)
        _ = self.cameras  # checks them

    def _check_sizes(self) -> None:
        """Refuse places and weights that are finite but cannot be meant."""
        check_finite(self.translation, "maps: translation")
        for name in ("template_vertices", "rest_vertices"):
            if getattr(self, name) is not None:
                check_finite(getattr(self, name), f"maps: {name}")
        if self.confidence is not None and not (
            self.confidence.min() >= 0 and self.confidence.max() <= HEAVIEST
        ):
            raise InputError(
                f"maps: confidence counts from 0 to {HEAVIEST:g}, "
                f"found {self.confidence.min():g} to {self.confidence.max():g}"
            )
        reach = float((FARTHEST + np.abs(self.box.lo)).max() / (self.box.hi - self.box.lo).min())
        for name, most in (("position", min(reach, 1e6)), ("normal", 1e3)):
            values = getattr(self, name)
            if values is None or (values.min() >= -most and values.max() <= most):
                continue
            for frame, images in enumerate(values):  # what is off the silhouette does not count
                covered = images[self.mask]
                if covered.size and np.abs(covered).max() > most:
                    raise InputError(
                        f"maps: {name} of frame {frame} has {np.abs(covered).max():g}; encoded values are about 0 to "
                        f"1, and at most {most:g} here"
                    )

    @classmethod
    def of(
        cls,
        imager: TemplateImager,
        *,
        position: np.ndarray | None,
        normal: np.ndarray | None,
        box: PositionBox,
        rotation: np.ndarray,
        translation: np.ndarray,
        fps: float,
        confidence: np.ndarray | None = None,
        rest_vertices: np.ndarray | None = None,
        contact_offset_m: float | None = None,
    ) -> MapFile:
        """Maps made with (or predicted for) an imager's template and cameras."""
        return cls(
            position=position,
            normal=normal,
            mask=imager.mask.numpy(),
            box_lo=box.lo,
            box_hi=box.hi,
            views=tuple(camera.name for camera in imager.cameras),
            view_matrices=np.stack([camera.view for camera in imager.cameras]),
            projection_matrices=np.stack([camera.projection for camera in imager.cameras]),
            template_vertices=imager.mesh.vertices,
            template_faces=imager.mesh.faces,
            rotation=rotation,
            translation=translation,
            fps=fps,
            layers=np.array([camera.layer for camera in imager.cameras]),
            confidence=confidence,
            depth=imager.raster.depth,
            rest_vertices=rest_vertices,
            layout_vertices=None if imager.layout is None else imager.layout.vertices,
            layout_faces=None if imager.layout is None else imager.layout.faces,
            contact_offset_m=contact_offset_m,
        )

    @property
    def n_frames(self) -> int:
        """T."""
        return len(self.rotation)

    def part(self, frames: slice) -> MapFile:
        """Some of the frames."""
        values = {name: getattr(self, name) for name in BY_FRAME}
        return replace(self, **{name: v[frames] for name, v in values.items() if v is not None})

    def parts(self, count: int) -> Iterator[MapFile]:
        """All frames in order, `count` at a time; the last part may be shorter."""
        return (self.part(slice(first, first + count)) for first in range(0, self.n_frames, count))

    @property
    def box(self) -> PositionBox:
        """The position box."""
        return PositionBox(self.box_lo, self.box_hi)

    @property
    def template(self) -> Mesh:
        """The template mesh."""
        return Mesh(self.template_vertices, self.template_faces, source="maps: template")

    @property
    def format_version(self) -> int:
        """Of the file that these maps are written to."""
        return FORMAT_VERSION if self.layout_vertices is None else FORMAT_VERSION + 1

    @cached_property
    def layout(self) -> Mesh | None:
        """The template laid out flat, where the cameras look at that."""
        if self.layout_vertices is None or self.layout_faces is None:
            if self.layout_vertices is None and self.layout_faces is None:
                return None
            raise InputError("maps: layout_vertices and layout_faces need each other; one of them is missing")
        return Mesh(self.layout_vertices, self.layout_faces, source="maps: layout")

    def imager(self, template: Mesh | None = None) -> TemplateImager:
        """The imager that the maps were made with; `template` in place of theirs, with the same faces."""
        mesh = self.template if template is None else template
        return TemplateImager.build(mesh, cameras=self.cameras, layout=self.layout)

    @property
    def rest(self) -> Mesh:
        """The garment in the shape that the frames are of: `rest_vertices`, or else the template."""
        if self.rest_vertices is None:
            return self.template
        return Mesh(self.rest_vertices, self.template_faces, source="maps: rest_vertices")

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras; `imager` makes the imager again."""
        height, width = self.mask.shape[1:]
        assert self.layers is not None  # zeros were put there
        matrices = zip(self.views, self.view_matrices, self.projection_matrices, self.layers, strict=True)
        return tuple(
            Camera(name, view, projection, (height, width), layer=int(layer))
            for name, view, projection, layer in matrices
        )
