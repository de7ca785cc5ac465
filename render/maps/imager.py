"""Everything that is constant for one template, in one object."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import torch

from render.cameras import Camera
from render.errors import InputError
from render.framing import frame_cameras
from render.maps.encoding import PositionBox, encode_normals
from render.maps.layout import check_layout, layout_camera, layout_sampling, one_place
from render.maps.operator import MapOperator
from render.maps.sampling import sampling
from render.mesh.mesh import Mesh
from render.mesh.normals import VertexNormals
from render.mesh.sparse import SparseProduct
from render.raster.raster import Raster, rasterize
from render.views import ViewsSpec


class TemplateImager:
    """A template, its cameras and what they see of it; makes maps of deformed versions and reads them back.

    Made by `build`. Device and dtype follow the tensors given to the methods; the attributes stay on the CPU.

    Attributes:
        mesh: the template, N vertices.
        cameras: S cameras of size (height, width), one an image: a view of two layers has two.
        raster: what they see.
        operator: the interpolation B.
        mask: (S, H, W) bool tensor, the silhouette.
        faces: (F, 3) int64 tensor.
        normals: vertex normals (..., N, 3) of vertices (..., N, 3).
        size: (height, width).
        layout: the mesh laid out flat (`render.maps.layout`), where that is projected in place of it; else None.
    """

    def __init__(
        self, mesh: Mesh, cameras: tuple[Camera, ...], raster: Raster, layout: Mesh | None = None
    ) -> None:
        self.mesh, self.cameras, self.raster, self.layout = mesh, cameras, raster, layout
        self.size = cameras[0].size
        self.faces = torch.from_numpy(mesh.faces)
        self.operator = MapOperator(raster, mesh.faces, len(mesh.vertices))
        self.mask = self.operator.mask
        self.normals = VertexNormals(mesh.faces, len(mesh.vertices))

    @cached_property
    def _sampling(self) -> tuple[SparseProduct, np.ndarray]:
        """Made when it is first asked for: bodies are imaged, and never read back."""
        if self.layout is None:
            return sampling(self.mesh, self.cameras, self.raster)
        return layout_sampling(self.mesh, self.layout, self.cameras, self.raster)

    @cached_property
    def places(self) -> np.ndarray:
        """(N, 3) metres, where the cameras see each vertex: at itself, or at one of its places in the layout."""
        return self.mesh.vertices if self.layout is None else one_place(self.layout, self.mesh)

    @cached_property
    def visible(self) -> np.ndarray:
        """(S, N) bool, which vertices each view sees and can be read at."""
        return self._sampling[1]

    @classmethod
    def build(
        cls,
        mesh: Mesh,
        *,
        views: ViewsSpec = ("front", "back"),
        size: tuple[int, int] = (256, 256),
        layers: int = 1,
        cameras: Sequence[Camera] | None = None,
        layout: Mesh | None = None,
        backend: str = "auto",
    ) -> TemplateImager:
        """Frame and rasterise a template.

        Args:
            mesh: the template at rest, metres, y up, facing +z.
            views: as for `frame_cameras`; not used if `cameras` is given.
            size: (height, width) of the maps; not used if `cameras` is given.
            layers: how many surfaces deep each view is imaged; layers that show nothing of the template are left
                out. Not used if `cameras` is given.
            cameras: cameras of another template: the body is imaged with those of its garment.
            layout: the mesh's faces laid out flat, to be projected in place of it by one camera that looks straight at
                it, without `views` and `layers`; or by `cameras`, which look at the layout then.
            backend: as for `rasterize`.

        Raises:
            InputError: whatever `frame_cameras` or `rasterize` refuses, or a layout of another mesh.
        """
        if layout is not None:
            check_layout(layout, mesh)
            looking = tuple(cameras or [layout_camera(layout, size)])
            return cls(mesh, looking, rasterize(layout, looking, backend=backend), layout)
        if cameras is not None:
            return cls(mesh, tuple(cameras), rasterize(mesh, cameras, backend=backend))
        framed = frame_cameras(mesh, views=views, size=size, layers=layers)
        raster = rasterize(mesh, framed, backend=backend)
        visible = np.asarray(raster.mask.any(axis=(1, 2)))
        return cls(mesh, tuple(itertools.compress(framed, visible)), raster.images(visible))

    def position_maps(self, vertices: torch.Tensor, box: PositionBox) -> torch.Tensor:
        """P of equation 1: vertices (..., N, 3) in metres to encoded maps (..., S, H, W, 3), background 0."""
        return self.operator(box.encode(vertices))

    def normal_maps(self, vertices: torch.Tensor) -> torch.Tensor:
        """N of equation 1: vertices (..., N, 3) to maps (..., S, H, W, 3) of encoded normals, background 0.

        Interpolated between the vertices and not scaled to unit length again: the map is linear in the normals.
        """
        return self.operator(encode_normals(self.normals(vertices)))

    def maps(self, vertices: torch.Tensor, box: PositionBox) -> tuple[torch.Tensor, torch.Tensor]:
        """Position and normal maps by one product, in little more time than either of them takes.

        Args:
            vertices: (..., N, 3) metres.
            box: the position box.

        Returns:
            What `position_maps` and `normal_maps` give, as views of one (..., S, H, W, 6) tensor.
        """
        images = self.operator(torch.cat([box.encode(vertices), encode_normals(self.normals(vertices))], -1))
        return images[..., :3], images[..., 3:]

    def sample(self, images: torch.Tensor) -> torch.Tensor:
        """Values of images at each vertex's projection, one reading per view, differentiable in the images.

        Only covered pixels count. For visible vertices only pixels that show their own surface do; for the
        others the reading is of whatever covers them (0 where nothing does): ask `visible`.

        Args:
            images: (..., S, H, W, C).

        Returns:
            (..., S, N, C).

        Raises:
            InputError: images of another number of views or size.
        """
        views, vertices = self.visible.shape
        if images.shape[-4:-1] != (views, *self.size):
            raise InputError(
                f"images must have shape (..., {views}, {self.size}, C), found {tuple(images.shape)}"
            )
        readings = self._sampling[0](images.reshape(*images.shape[:-4], -1, images.shape[-1]))
        return readings.reshape(*images.shape[:-4], views, vertices, images.shape[-1])
