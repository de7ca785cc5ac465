"""The vertices of an OBJ that is one frame of a moving mesh: all else is the same in most frames, and only compared."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from render.files.obj_numbers import columns, gathered
from render.limits import FARTHEST_IN_FILES

_NEWLINE = 10


def vertices_and_rest(path: Path) -> tuple[np.ndarray | None, bytes]:
    """The vertices of an OBJ, and the text of all else but normals and comments.

    Several times as fast as reading the triangles of every frame.

    Returns:
        (N, 3) float64; and the other lines, with where among the vertices they stand. Without vertices for what needs
        the whole reader: less plain lines, and what it will refuse.
    """
    text = path.read_bytes()
    content = np.frombuffer(text if text.endswith(b"\n") else text + b"\n", np.uint8).copy()
    ends = np.flatnonzero(content == _NEWLINE)
    starts = np.append(0, ends[:-1] + 1)
    first, second = content[starts], content[np.minimum(starts + 1, ends)]
    vertex = (first == ord("v")) & (second == ord(" "))
    same = ~vertex & (first != ord("#")) & ~((first == ord("v")) & (second == ord("n")))
    before = np.cumsum(vertex, dtype=np.int32)[same]  # faces may count back from where they stand
    rest = before.tobytes() + gathered(content, starts[same], ends[same]).tobytes()
    content[starts[vertex]] = ord(" ")
    try:
        vertices = columns(gathered(content, starts[vertex], ends[vertex]), 3, 3)
    except ValueError:
        return None, rest
    return (vertices if (np.abs(vertices) <= FARTHEST_IN_FILES).all() else None), rest
