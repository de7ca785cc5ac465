"""Making position and normal maps, two views of 256 x 256: the sparse operator against its alternatives.

  operator       TemplateImager.maps, one frame
  rerasterise    OpenGL draws the template again for every frame, positions and normals interpolated by it
                 (context, program and template buffers kept open), and the maps are read back
  gather         NumPy: face ids and barycentrics known, corners gathered and blended
Each is also given 32 frames at once (batch, in ms a frame). All include the same vertex normals (normals_ms).
Torch and the software rasteriser use one thread each (LP_NUM_THREADS overrides the latter).

Further: the bytes that the bare product must move in the time that a copy of as many bytes takes; the product and its
gradient against torch's own sparse matrices; drawing face ids by OpenGL against the NumPy reference. On a machine with
CUDA a section more for each template: frames a second on the GPU.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch

# This folder's own render.py must not hide the package.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from render import Camera, Mesh, PositionBox, TemplateImager, encode_normals, rasterize
from render.raster.context import GL_BACKENDS, GLContext, GLUnavailableError, open_context
from scripts.bench import cloth
from scripts.bench.measuring import Results, command, interleaved

TEMPLATES = {"tshirt": (cloth.TSHIRT, 4400), "dress": (cloth.DRESS, 12100)}  # and about how many vertices
GPU_BATCHES = (1, 32, 256)
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
        """(T, N, 6) float32 -> (T, S, H, W, 6) float32, background 0."""
        images = np.zeros((len(values), *self._shape), np.float32)
        for image, frame in zip(images, values, strict=True):
            blended = np.einsum("pk,pkc->pc", self._weights, frame[self._corners])
            image.reshape(-1, 6)[self._places] = blended
        return images


def measure(quick: bool) -> Results:
    """All numbers, one section a template, and one more for each where there is CUDA."""
    os.environ.setdefault("LP_NUM_THREADS", "1")  # read by Mesa's software rasteriser when its context opens
    size, batch, rounds = ((48, 48), 2, 1) if quick else ((256, 256), 32, 9)
    backend = _backend()
    results: Results = {}
    for name, (cut, n_vertices) in TEMPLATES.items():
        mesh = cloth.garment(cut, 300 if quick else n_vertices)
        frames = torch.from_numpy(cloth.moved(mesh.vertices, batch).astype(np.float32))
        started = time.perf_counter()
        imager = TemplateImager.build(mesh, size=size, backend=backend)
        results[name] = {
            "vertices": len(mesh.vertices),
            "faces": len(mesh.faces),
            "covered_pixels": int(imager.raster.mask.sum()),
            "setup_seconds": time.perf_counter() - started,
            **_maps(imager, frames, rounds),
            **_bandwidth(imager, frames, rounds),
            **_torch_sparse(imager, frames[-1], rounds),
            **_rasterisers(imager, min(rounds, 3)),
        }
        if torch.cuda.is_available():
            results[f"{name}_gpu"] = _gpu(imager, frames, rounds)
    return results


def _maps(imager: TemplateImager, frames: torch.Tensor, rounds: int) -> dict[str, float]:
    """The three ways to make maps, one frame and many."""
    box, one, batch = PositionBox.around(frames.numpy()), frames[-1:], len(frames)
    gather = Gather(imager)

    def values(some: torch.Tensor) -> np.ndarray:
        return torch.cat([box.encode(some), encode_normals(imager.normals(some))], -1).numpy()

    with open_context(imager.raster.backend) as context:
        draw = Rerasteriser(context, imager.mesh, imager.cameras)

        def drawn(some: torch.Tensor) -> list[np.ndarray]:
            return [draw(frame) for frame in values(some)]

        _check_same(imager, drawn(one)[0], gather(values(one))[0])
        times = interleaved(
            {
                "operator": lambda: imager.maps(one, box),
                "operator_batch": lambda: imager.maps(frames, box),
                "rerasterise": lambda: drawn(one),
                "rerasterise_batch": lambda: drawn(frames),
                "gather": lambda: gather(values(one)),
                "gather_batch": lambda: gather(values(frames)),
                "normals": lambda: imager.normals(one),
            },
            rounds=rounds,
        )
    found = {f"{name}_ms": times.ms(name) for name in ("operator", "rerasterise", "gather", "normals")}
    for name in ("operator", "rerasterise", "gather"):
        found[f"{name}_batch_ms"] = times.ms(f"{name}_batch") / batch
    for end in ("", "_batch"):
        found[f"speedup_over_rerasterising{end}"] = times.ratio(f"rerasterise{end}", f"operator{end}")
        found[f"speedup_over_gather{end}"] = times.ratio(f"gather{end}", f"operator{end}")
    return found


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
        # Values float32, columns and row starts int32; dense factor read and product written once.
        moved = entries * (4 + 4) + 4 * (pixels + 1) + 4 * 6 * len(some) * (vertices + pixels)
        source = torch.rand(moved // 8)
        target = torch.empty_like(source)
        times = interleaved(
            {
                "product": partial(imager.operator, attributes),
                "copy": partial(target.copy_, source),
                "new": source.clone,
            },
            rounds=rounds,
        )
        found[f"gigabytes_per_second{name}"] = moved / times.s("product") / 1e9
        found[f"fraction_of_copy_bandwidth{name}"] = times.ratio("copy", "product")
        found[f"fraction_of_copy_to_new_memory{name}"] = times.ratio("new", "product")
    return found


def _torch_sparse(imager: TemplateImager, vertices: torch.Tensor, rounds: int) -> dict[str, float]:
    """The product, and with its gradient, against torch's own sparse matrices."""
    attributes = torch.cat([vertices, vertices], dim=-1).requires_grad_()
    plain = attributes.detach()
    places = np.flatnonzero(imager.raster.mask)
    corners = imager.mesh.faces[imager.raster.face_id.reshape(-1)[places]]
    weights = imager.raster.barycentric.reshape(-1, 3)[places].astype(np.float32)
    entries = torch.from_numpy(np.stack([np.repeat(places, 3), corners.reshape(-1)]))
    shape = (imager.raster.face_id.size, len(vertices))
    values = torch.from_numpy(weights.reshape(-1))
    matrix = torch.sparse_coo_tensor(entries, values, shape, check_invariants=True).to_sparse_csr()
    upstream = torch.rand(matrix.shape[0], 6)
    flat = upstream.reshape(*imager.mask.shape, 6)
    times = interleaved(
        {
            "ours": lambda: imager.operator(plain),
            "torch": lambda: matrix @ plain,
            "ours_backward": lambda: torch.autograd.grad(imager.operator(attributes), attributes, flat),
            "torch_backward": lambda: torch.autograd.grad(
                torch.sparse.mm(matrix, attributes), attributes, upstream
            ),
        },
        rounds=rounds,
    )
    return {
        "ratio_torch_sparse_to_ours": times.ratio("torch", "ours"),
        "forward_backward_ms": times.ms("ours_backward"),
        "ratio_torch_sparse_to_ours_backward": times.ratio("torch_backward", "ours_backward"),
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


def _gpu(imager: TemplateImager, frames: torch.Tensor, rounds: int) -> dict[str, float]:
    """Frames a second on the GPU: vertices and maps stay there, the product alone and with its gradient."""
    box = PositionBox.around(frames.numpy())
    found = {}
    for batch in GPU_BATCHES:
        some = frames[torch.arange(batch) % len(frames)].cuda().requires_grad_()

        def maps(some: torch.Tensor = some) -> None:
            with torch.no_grad():
                imager.maps(some, box)
            torch.cuda.synchronize()

        def both(some: torch.Tensor = some) -> None:
            positions, normals = imager.maps(some, box)
            torch.autograd.grad(positions.sum() + normals.sum(), some)
            torch.cuda.synchronize()

        times = interleaved({"maps": maps, "both": both}, rounds=rounds)
        found[f"frames_per_second_{batch}"] = batch / times.s("maps")
        found[f"frames_per_second_with_gradient_{batch}"] = batch / times.s("both")
    return found


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
