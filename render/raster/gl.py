"""Face ids drawn by OpenGL."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np

from render.errors import InputError
from render.raster.context import GLContext
from render.raster.peeling import NearestLayers
from render.raster.screen import ScreenFaces

# The projection is done in float64 beforehand, so the vertex shader only passes image positions on. There is no
# depth here: OpenGL says which faces cover a pixel's centre, one a pass in the order of their numbers, which are
# exact where any depth it could compare would be rounded. Which of them is nearest is decided in float64.
_VERTEX_SHADER = """
#version 330
in vec2 in_position;  // normalised device coordinates
in float in_number;   // index of the face + 1
flat out float number;
void main() {
    gl_Position = vec4(in_position, 0.0, 1.0);
    number = in_number;
}
"""
_FRAGMENT_SHADER = """
#version 330
uniform sampler2D previous;
flat in float number;
out float face;
void main() {
    if (number <= texelFetch(previous, ivec2(gl_FragCoord.xy), 0).r) discard;
    face = number;
}
"""
_MOST_FACES = 1 << 24  # whole numbers that float32 holds exactly
_NO_FACE = float(2 * _MOST_FACES)  # above every number, so that nothing is drawn there in later passes


def gl_face_ids(context: GLContext, faces: ScreenFaces, size: tuple[int, int], layers: int = 1) -> np.ndarray:
    """The nearest faces at every pixel centre, both sides drawn, one sample a pixel.

    As many passes as faces lie over one another.

    Args:
        context: an open context, current in this thread.
        faces: projected faces, at most 2^24 of them.
        size: (height, width).
        layers: how many faces deep, L.

    Returns:
        (L, height, width) int32, -1 where there is no further face. Equal to `reference_face_ids` wherever the
        pixel's centre is more than 1/100 pixel from every edge (hardware snaps corners to 1/256 pixel).

    Raises:
        InputError: the driver fails. ValueError: too many faces.
    """
    import moderngl  # noqa: PLC0415

    nearest = NearestLayers(faces, size, layers)
    if len(faces.ids) == 0:
        return nearest.face_id
    if len(faces.ids) >= _MOST_FACES:
        raise ValueError(f"at most {_MOST_FACES - 1} faces can be drawn, found {len(faces.ids)}")
    try:
        with ExitStack() as owned:
            _add_all(context.gl, _vertex_data(faces, size), size, nearest, owned)
    except moderngl.Error as error:
        raise InputError(f"{context.renderer} ({context.backend}) fails to draw: {error}") from error
    return nearest.face_id


def _add_all(
    gl: Any, vertices: np.ndarray, size: tuple[int, int], nearest: NearestLayers, owned: ExitStack
) -> None:
    """Pass after pass, add the faces found at each pixel; `owned` releases what is made meanwhile."""
    import moderngl  # noqa: PLC0415

    def own(resource: Any) -> Any:
        owned.callback(resource.release)
        return resource

    program = own(gl.program(vertex_shader=_VERTEX_SHADER, fragment_shader=_FRAGMENT_SHADER))
    buffer = own(gl.buffer(vertices.tobytes()))
    array = own(gl.vertex_array(program, [(buffer, "2f 1f", "in_position", "in_number")]))
    images = [own(gl.texture(size[::-1], 1, dtype="f4")) for _ in range(2)]
    targets = [(image, own(gl.framebuffer([image]))) for image in images]
    gl.enable_only(moderngl.NOTHING)  # no depth test, no culling, no blending: the last fragment stays
    targets[1][1].clear(0.0)
    while True:
        (image, target), (previous, _) = targets
        target.use()
        target.clear(_NO_FACE)
        previous.use(0)
        array.render(moderngl.TRIANGLES)
        drawn = np.frombuffer(image.read(), np.float32)
        pixel = np.flatnonzero(drawn < _NO_FACE)
        if len(pixel) == 0:
            return
        nearest.add(pixel, drawn[pixel].astype(np.int64) - 1)
        targets.reverse()


def _vertex_data(faces: ScreenFaces, size: tuple[int, int]) -> np.ndarray:
    """(3 K, 3) float32, the attributes of the shader above, the last face first: of several the lowest stays.

    The one vertical flip: OpenGL's row 0 is the bottom one. Image y is handed over as if it ran upwards, so
    the rows come back with row 0 at the top and nothing is flipped afterwards.
    """
    height, width = size
    data = np.empty((len(faces.ids), 3, 3), np.float32)
    data[..., :2] = faces.corners / (width / 2, height / 2) - 1
    data[..., 2] = np.arange(1, len(faces.ids) + 1)[:, None]
    return data[::-1].reshape(-1, 3)
