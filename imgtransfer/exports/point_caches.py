"""Point caches, with the meshes that they move as OBJ beside: `walk.pc2` and `walk.obj`, `walk_body.pc2` and so on.

The forms are described in `render.files.point_caches`, which reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from imgtransfer.data.clip import Clip
from imgtransfer.data.mesh_output import save_obj
from imgtransfer.exports.objects import MovingObject, objects_of
from render import Mesh
from render.files.atomic import written_whole
from render.files.point_caches import mdd_header, pc2_header


@contextmanager
def written_caches(path: Path, *, n_frames: int, step: int = 1) -> Iterator[Callable[[Clip], None]]:
    """Yield what takes the frames of a clip, some at a time; see `written_animation`.

    Args:
        path: of the garment's cache, or of the body's where there is no garment in motion; ends in .pc2 or .mdd.
        n_frames: that will come, T. step: what their numbers in the clip count by.
    """
    files: dict[str, IO[bytes]] = {}
    moved: dict[Path, Mesh] = {}  # by where its OBJ is written, once all frames are
    number = ">f4" if path.suffix.lower() == ".mdd" else "<f4"
    with ExitStack() as stack:

        def begin(thing: MovingObject, target: Path, fps: float) -> IO[bytes]:
            moved[target.with_suffix(".obj")] = thing.rest
            file = stack.enter_context(stack.enter_context(written_whole(target)).open("wb"))
            points = len(thing.surface.vertices)
            if number == ">f4":
                file.write(mdd_header(points, np.arange(n_frames) * (step / fps)))
            else:
                file.write(pc2_header(points, n_frames, rate=step))
            return file

        def add(part: Clip) -> None:
            objects = objects_of(part)
            for thing in objects:
                named = thing.name == "garment" or len(objects) == 1
                target = path if named else path.with_name(f"{path.stem}_{thing.name}{path.suffix}")
                if thing.name not in files:
                    files[thing.name] = begin(thing, target, part.fps)
                files[thing.name].write(thing.of_file(part).astype(number).tobytes())

        yield add
        for target, mesh in moved.items():
            save_obj(target, mesh)
