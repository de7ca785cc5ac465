"""Face ids drawn by OpenGL."""

from __future__ import annotations

import numpy as np

from render.context import GLContext
from render.screen import ScreenFaces

# The projection is done in float64 beforehand, so the vertex shader only passes image positions on. Depth is
# evaluated from the face's plane at the pixel centre itself: the rasteriser's own interpolation starts from
# corners snapped to 1/256 pixel, which on steep faces moves the depth enough to change the winner.
_VERTEX_SHADER = """
#version 330
in vec2 in_position;  // normalised device coordinates
in vec2 in_origin;    // pixels: first corner of the face
in vec3 in_plane;     // depth at the origin and its change per pixel in x and y
in float in_id;       // face index + 1
flat out vec2 origin;
flat out vec3 plane;
flat out float id;
void main() {
    gl_Position = vec4(in_position, 0.0, 1.0);
    origin = in_origin;
    plane = in_plane;
    id = in_id;
}
"""
_FRAGMENT_SHADER = """
#version 330
flat in vec2 origin;
flat in vec3 plane;
flat in float id;
out float face;
void main() {
    face = id;
    gl_FragDepth = plane.x + dot(plane.yz, gl_FragCoord.xy - origin);
}
"""
_MOST_FACES = 1 << 24  # whole numbers that float32 holds exactly


def gl_face_ids(context: GLContext, faces: ScreenFaces, size: tuple[int, int]) -> np.ndarray:
    """The nearest face at every pixel centre, both sides drawn, one sample a pixel.

    Args:
        context: an open context, current in this thread.
        faces: projected faces, at most 2^24 of them.
        size: (height, width).

    Returns:
        (height, width) int32, -1 where there is no face. Equal to `reference_face_ids` wherever the pixel's
        centre is more than 1/100 pixel from every edge (hardware snaps corners to 1/256 pixel).
    """
    import moderngl  # noqa: PLC0415

    if len(faces.ids) == 0:
        return np.full(size, -1, np.int32)
    if faces.ids.max() + 1 >= _MOST_FACES:
        raise ValueError(f"at most {_MOST_FACES - 2} faces can be drawn, found index {faces.ids.max()}")
    gl, (height, width) = context.gl, size
    program = gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=_FRAGMENT_SHADER)
    buffer = gl.buffer(_vertex_data(faces, size).tobytes())
    names = ("in_position", "in_origin", "in_plane", "in_id")
    array = gl.vertex_array(program, [(buffer, "2f 2f 3f 1f", *names)])
    colour, depth = gl.texture((width, height), 1, dtype="f4"), gl.depth_renderbuffer((width, height))
    target = gl.framebuffer([colour], depth)
    try:
        target.use()
        gl.enable_only(moderngl.DEPTH_TEST)  # no culling, no blending
        gl.depth_func = "<"
        target.clear(0.0, depth=1.0)
        array.render(moderngl.TRIANGLES)
        drawn = np.frombuffer(colour.read(), np.float32).reshape(height, width)
    finally:
        for resource in (target, colour, depth, array, buffer, program):
            resource.release()
    return drawn.round().astype(np.int32) - 1


def _vertex_data(faces: ScreenFaces, size: tuple[int, int]) -> np.ndarray:
    """(3 K, 8) float32, the attributes of the shader above.

    The one vertical flip: OpenGL's row 0 is the bottom one. Image y is handed over as if it ran upwards, so
    the rows come back with row 0 at the top and nothing is flipped afterwards.
    """
    height, width = size
    position = faces.corners / (width / 2, height / 2) - 1
    # Reciprocal depth, near to far onto 0 to 1: affine over the image like 1/depth, and tight around the
    # mesh.
    values = np.stack(
        [faces.reciprocal_depth(np.arange(len(faces.ids)), faces.corners[:, k]) for k in range(3)]
    )
    nearest, farthest = values.max(), values.min()
    spread = max(nearest - farthest, 1e-9 * nearest) * 1.002  # a hair wider, so that rounding clips nothing
    plane = -faces.plane / spread
    plane[:, 0] += nearest / spread + 0.001
    data = np.empty((len(faces.ids), 3, 8), np.float32)
    data[..., 0:2] = position
    data[..., 2:4] = faces.corners[:, :1]
    data[..., 4:7] = plane[:, None]
    data[..., 7] = (faces.ids + 1)[:, None]
    return data.reshape(-1, 8)
