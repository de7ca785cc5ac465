#!/usr/bin/env python
"""Making position and normal maps, two views of 256 x 256: the sparse operator against its alternatives.

  operator       TemplateImager.position_maps and normal_maps, one frame
  batch          the same for 32 frames at once, per frame
  rerasterise    OpenGL draws the template again for every frame, positions and normals interpolated by it
                 (context, program and template buffers kept open), and the maps are read back
  gather         NumPy: face ids and barycentrics known, corners gathered and blended
All four include vertex normals by render.vertex_normals (normals_ms). Torch and the software rasteriser use one
thread each (LP_NUM_THREADS overrides the latter).

Further: the bytes that the bare product must move in the time that a copy of as many bytes takes; forward and
backward of the product against torch's own; drawing face ids by OpenGL against the NumPy reference.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from render import Camera, Mesh, PositionBox, TemplateImager, encode_normals, rasterize, vertex_normals
from render.context import GL_BACKENDS, GLContext, GLUnavailableError, open_context
from scripts.bench import shapes
from scripts.bench.measuring import Results, command, interleaved

_VERTEX_SHADER = """
#version 330
uniform mat4 to_clip;
in vec3 in_template;
in vec3 in_position;
in vec3 in_normal;
out vec3 position;
out vec3 normal;
void main() {
    gl_Position = to_clip * vec4(in_template, 1.0);
    gl_Position.y = -gl_Position.y;  // row 0 at the top
    position = in_position;
    normal = in_normal;
}
"""
_FRAGMENT_SHADER = """
#version 330
in vec3 position;
in vec3 normal;
layout(location = 0) out vec4 position_map;
layout(location = 1) out vec4 normal_map;
void main() {
    position_map = vec4(position, 1.0);
    normal_map = vec4(normal, 1.0);
}
"""


class Rerasteriser:
    """Draws maps of every frame anew; everything that is constant stays on the GL side.

    Args:
        context: stays open for as long as this is used.
        mesh: the template.
        cameras: all of one size.
    """

    def __init__(self, context: GLContext, mesh: Mesh, cameras: Sequence[Camera]) -> None:
        import moderngl  # noqa: PLC0415

        self._gl, self._triangles, self._test = context.gl, moderngl.TRIANGLES, moderngl.DEPTH_TEST
        self.height, self.width = cameras[0].size
        self._program = self._gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=_FRAGMENT_SHADER)
        self._values = self._gl.buffer(reserve=len(mesh.vertices) * 6 * 4, dynamic=True)
        template = self._gl.buffer(mesh.vertices.astype(np.float32).tobytes())
        self._array = self._gl.vertex_array(
            self._program,
            [(template, "3f", "in_template"), (self._values, "3f 3f", "in_position", "in_normal")],
            index_buffer=self._gl.buffer(mesh.faces.astype(np.int32).tobytes()),
        )
        size = (self.width, self.height)
        maps = [self._gl.texture(size, 4, dtype="f4") for _ in range(2)]
        self._target = self._gl.framebuffer(maps, self._gl.depth_renderbuffer(size))
        to_clip = [camera.projection @ camera.view for camera in cameras]
        self._to_clip = [matrix.T.astype(np.float32).tobytes() for matrix in to_clip]

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(N, 6) float32 encoded positions and normals -> (2 maps, S, H, W, 3) float32, background 0."""
        self._values.write(values)
        images = np.empty((2, len(self._to_clip), self.height, self.width, 3), np.float32)
        self._target.use()
        self._gl.enable_only(self._test)
        for view, matrix in enumerate(self._to_clip):
            self._program["to_clip"].write(matrix)
            self._target.clear(0.0, depth=1.0)
            self._array.render(self._triangles)
            for number in range(2):
                self._target.read_into(images[number, view], components=3, attachment=number, dtype="f4")
        return images


class Gather:
    """Maps by gathering and blending corners in NumPy."""

    def __init__(self, imager: TemplateImager) -> None:
        raster = imager.raster
        self._places = np.flatnonzero(raster.mask)
        self._corners = imager.mesh.faces[raster.face_id.reshape(-1)[self._places]]
        self._weights = raster.barycentric.reshape(-1, 3)[self._places].astype(np.float32)
        self._shape = (*raster.face_id.shape, 6)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(N, 6) float32 -> (S, H, W, 6) float32, background 0."""
        images = np.zeros(self._shape, np.float32)
        images.reshape(-1, 6)[self._places] = np.einsum("pk,pkc->pc", self._weights, values[self._corners])
        return images


def measure(quick: bool) -> Results:
    """All numbers, one section a template."""
    os.environ.setdefault("LP_NUM_THREADS", "1")  # read by Mesa's software rasteriser when its context opens
    templates = {"tube_4k": shapes.SMALL, "tube_12k": shapes.LARGE}
    if quick:
        templates = {"tube_0.2k": (20, 10)}
    size, batch, rounds = ((48, 48), 2, 1) if quick else ((256, 256), 32, 9)
    backend = _backend()
    return {
        name: _template(shapes.garment(*shape), backend, size, batch, rounds)
        for name, shape in templates.items()
    }


def _template(mesh: Mesh, backend: str, size: tuple[int, int], batch: int, rounds: int) -> dict[str, float]:
    imager = TemplateImager.build(mesh, size=size, backend=backend)
    frames = torch.from_numpy(shapes.wrinkled(mesh, batch))
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "covered_pixels": int(imager.raster.mask.sum()),
        **_maps(imager, frames, rounds),
        **_bandwidth(imager, frames, rounds),
        **_backward(imager, frames[-1], rounds),
        **_rasterisers(imager, min(rounds, 3)),
    }


def _maps(imager: TemplateImager, frames: torch.Tensor, rounds: int) -> dict[str, float]:
    """The four ways to make maps."""
    box, one, batch = PositionBox.around(frames.numpy()), frames[-1], len(frames)
    gather = Gather(imager)

    def values() -> np.ndarray:
        return torch.cat([box.encode(one), encode_normals(vertex_normals(one, imager.faces))], 1).numpy()

    with open_context(imager.raster.backend) as context:
        draw = Rerasteriser(context, imager.mesh, imager.cameras)
        _check_same(imager, draw(values()), gather(values()))
        times = interleaved(
            {
                "operator": lambda: (imager.position_maps(one, box), imager.normal_maps(one)),
                "batch": lambda: (imager.position_maps(frames, box), imager.normal_maps(frames)),
                "rerasterise": lambda: draw(values()),
                "gather": lambda: gather(values()),
                "normals": lambda: vertex_normals(one, imager.faces),
            },
            rounds=rounds,
        )
    return {
        "operator_ms": times.ms("operator"),
        "operator_batch_ms": times.ms("batch") / batch,
        "rerasterise_ms": times.ms("rerasterise"),
        "gather_ms": times.ms("gather"),
        "normals_ms": times.ms("normals"),
        "ratio_to_rerasterise": times.ratio("rerasterise", "operator"),
        "ratio_to_rerasterise_batch": batch * times.ratio("rerasterise", "batch"),
        "ratio_to_gather": times.ratio("gather", "operator"),
    }


def _check_same(imager: TemplateImager, drawn: np.ndarray, gathered: np.ndarray) -> None:
    """The alternatives must do the same job: equal but for the pixels at the edges of faces."""
    difference = np.abs(np.concatenate(list(drawn), axis=-1) - gathered)[imager.raster.mask]
    if np.median(difference) > 1e-3:
        raise RuntimeError(f"OpenGL draws other maps: median difference {np.median(difference):.4f}")


def _bandwidth(imager: TemplateImager, frames: torch.Tensor, rounds: int) -> dict[str, float]:
    """The bare product of six channels against a copy that moves as many bytes (reading and writing)."""
    found = {}
    pixels, vertices = imager.mask.numel(), frames.shape[1]
    entries = 3 * int(imager.raster.mask.sum())
    for name, some in (("", frames[:1]), ("_batch", frames)):
        attributes = torch.cat([some, some], dim=-1)
        # Values float32, columns and row starts int64; dense factor read and product written once.
        moved = entries * (4 + 8) + 8 * (pixels + 1) + 4 * 6 * len(some) * (vertices + pixels)
        source = torch.rand(moved // 8)
        target = torch.empty_like(source)
        times = interleaved(
            {
                "product": partial(imager.operator, attributes),
                "copy": partial(target.copy_, source),
            },
            rounds=rounds,
        )
        found[f"gigabytes_per_second{name}"] = moved / times.s("product") / 1e9
        found[f"fraction_of_copy_bandwidth{name}"] = times.ratio("copy", "product")
    return found


def _backward(imager: TemplateImager, vertices: torch.Tensor, rounds: int) -> dict[str, float]:
    """Forward and backward, with the transpose that is kept and with torch's own sparse product."""
    attributes = torch.cat([vertices, vertices], dim=-1).requires_grad_()
    matrix = imager.operator._product.placed(attributes.device, attributes.dtype)[0]
    upstream = torch.rand(matrix.shape[0], 6)
    flat = upstream.reshape(*imager.mask.shape, 6)
    times = interleaved(
        {
            "kept": lambda: torch.autograd.grad(imager.operator(attributes), attributes, flat),
            "torch": lambda: torch.autograd.grad(torch.sparse.mm(matrix, attributes), attributes, upstream),
        },
        rounds=rounds,
    )
    return {
        "forward_backward_ms": times.ms("kept"),
        "ratio_torch_sparse_to_ours_backward": times.ratio("torch", "kept"),
    }


def _rasterisers(imager: TemplateImager, rounds: int) -> dict[str, float]:
    """`rasterize` from nothing: by OpenGL, and by the NumPy reference."""
    times = interleaved(
        {
            "gl": lambda: rasterize(imager.mesh, imager.cameras, backend=imager.raster.backend),
            "numpy": lambda: rasterize(imager.mesh, imager.cameras, backend="numpy"),
        },
        rounds=rounds,
    )
    return {"rasterize_gl_ms": times.ms("gl"), "ratio_numpy_rasteriser_to_gl": times.ratio("numpy", "gl")}


def _backend() -> str:
    """The first of the GL backends that opens."""
    for backend in GL_BACKENDS:
        try:
            with open_context(backend):
                return backend
        except GLUnavailableError as error:
            print(error, file=sys.stderr)
    raise SystemExit("this bench compares with OpenGL; run: apt-get install libegl1 libgl1-mesa-dri")


if __name__ == "__main__":
    command(__doc__, measure)
