"""How pictures light a surface, in NumPy and in OpenGL, and what draws it by the latter."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np

from render import Camera, InputError
from render.raster import GLContext

_LIGHT = np.array([0.35, 0.55, 0.76])  # from above, over the viewer's right shoulder, in camera axes
_LIGHT /= np.linalg.norm(_LIGHT)
_AMBIENT, _DIFFUSE, _FACING, _HIGHLIGHT, _SHININESS = 0.42, 0.55, 0.12, 0.06, 12

_VERTEX_SHADER = """
#version 330
uniform mat4 projection;
in vec3 in_position;  // in camera axes, metres
in vec3 in_normal;
in vec3 in_colour;
out vec3 normal;
out vec3 colour;
void main() {
    gl_Position = projection * vec4(in_position, 1.0);
    gl_Position.y = -gl_Position.y;  // OpenGL's row 0 is the bottom one
    normal = in_normal;
    colour = in_colour;
}
"""
_FRAGMENT_SHADER = f"""
#version 330
const vec3 light = vec3({", ".join(map(str, _LIGHT))});
in vec3 normal;
in vec3 colour;
out vec3 lit;
void main() {{
    vec3 n = normal / max(length(normal), 1e-9);
    n = n.z < 0.0 ? -n : n;
    float towards = dot(n, light);
    float reflected = 2.0 * towards * n.z - light.z;
    float bright = {_AMBIENT} + {_DIFFUSE} * clamp(towards, 0.0, 1.0) + {_FACING} * clamp(n.z, 0.0, 1.0);
    lit = colour * bright + {_HIGHLIGHT} * pow(clamp(reflected, 0.0, 1.0), {_SHININESS}.0);
}}
"""


@dataclass(frozen=True, eq=False)
class Surface:
    """What is drawn, all of it in one mesh.

    Args:
        vertices: (N, 3) float64, metres. faces: (F, 3) int.
        normals: (N, 3) float64, unit vectors. colours: (N, 3) RGB in [0, 1].
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    colours: np.ndarray


def lit(colour: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(P, 3) colours and normals in camera axes -> (P, 3) lit colours: Lambert and a faint highlight.

    The inside of cloth is lit as its outside.
    """
    normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
    normal = normal * np.where(normal[:, 2:] < 0, -1, 1)
    towards = normal @ _LIGHT
    reflected = 2 * towards * normal[:, 2] - _LIGHT[2]
    bright = _AMBIENT + _DIFFUSE * np.clip(towards, 0, 1) + _FACING * np.clip(normal[:, 2], 0, 1)
    return colour * bright[:, None] + _HIGHLIGHT * np.clip(reflected, 0, 1)[:, None] ** _SHININESS


def draw_lit(context: GLContext, surface: Surface, camera: Camera) -> np.ndarray:
    """The surface as a camera sees it, lit as by `lit`, on white: one pass with a depth buffer.

    Unlike `rasterize`, which orders faces in float64, this rounds depths to 24 bits; nothing is measured in pictures.

    Args:
        context: open, current in this thread.

    Returns:
        (H, W, 3) uint8, row 0 at the top.

    Raises:
        InputError: the driver fails.
    """
    points = camera.to_camera(surface.vertices)
    attributes = np.concatenate(
        [points, surface.normals @ camera.view[:3, :3].T, surface.colours], axis=1
    ).astype(np.float32)
    try:
        with ExitStack() as owned:
            target, array = _scene(context, attributes, surface.faces, camera.size, owned)
            uniform: Any = array.program["projection"]
            uniform.write(_around(camera, -points[:, 2]).T.astype(np.float32).tobytes())
            context.gl.enable_only(moderngl.DEPTH_TEST)
            target.use()
            target.clear(1.0, 1.0, 1.0, 1.0)
            array.render(moderngl.TRIANGLES)
            pixels = np.frombuffer(target.read(components=4), np.uint8)
    except moderngl.Error as error:
        raise InputError(f"{context.renderer} ({context.backend}) fails to draw: {error}") from error
    return pixels.reshape(*camera.size, 4)[..., :3]


def _around(camera: Camera, depths: np.ndarray) -> np.ndarray:
    """(4, 4) the camera's projection with near and far planes close to depths (N,), which cut nothing off."""
    near = max(camera.near, 0.99 * float(depths.min()))
    far = max(1.01 * float(depths.max()), 2 * near)
    projection = camera.projection.copy()
    projection[2, 2:] = -(far + near) / (far - near), -2 * far * near / (far - near)
    return projection


def _scene(
    context: GLContext, attributes: np.ndarray, faces: np.ndarray, size: tuple[int, int], owned: ExitStack
) -> tuple[moderngl.Framebuffer, moderngl.VertexArray]:
    """What is drawn into, and what draws; `owned` releases both.

    Args:
        attributes: (N, 9) float32, position and normal in camera axes, and colour.
        faces: (F, 3). size: (height, width).
    """

    def own(resource: Any) -> Any:
        owned.callback(resource.release)
        return resource

    gl, shape = context.gl, size[::-1]
    program = own(gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=_FRAGMENT_SHADER))
    points = own(gl.buffer(np.ascontiguousarray(attributes).tobytes()))
    corners = own(gl.buffer(faces.astype(np.int32).tobytes()))
    layout = [(points, "3f 3f 3f", "in_position", "in_normal", "in_colour")]
    array = own(gl.vertex_array(program, layout, index_buffer=corners))
    image, depth = own(gl.texture(shape, 4)), own(gl.depth_renderbuffer(shape))
    return own(gl.framebuffer([image], depth)), array
