"""All bad inputs by name, and those of them that the ordinary run takes."""

from __future__ import annotations

import random
import zlib
from collections.abc import Iterable, Sequence
from functools import cache

from tests.bad_inputs import byte_faults as bytes_
from tests.bad_inputs import image_faults as images
from tests.bad_inputs import json_faults as jsons
from tests.bad_inputs import npz_faults as npz
from tests.bad_inputs import pickle_faults as pickles
from tests.bad_inputs import readings as r
from tests.bad_inputs import text_faults as texts
from tests.bad_inputs.arguments import argument_cases
from tests.bad_inputs.case import Case, Fault, Reading, case_of
from tests.bad_inputs.settings import setting_cases
from tests.bad_inputs.special import special_cases

SEED = 9
ORDINARY = 70  # cases of the ordinary run


@cache
def cases() -> dict[str, Case]:
    """Every case by its name, in a fixed order."""
    found: dict[str, Case] = {}
    for case in [*_of_files(), *argument_cases(), *setting_cases(), *special_cases()]:
        if case.name in found:
            raise ValueError(f"two cases are called {case.name}")
        found[case.name] = case
    return found


def ordinary() -> list[str]:
    """The names of the ordinary run: as many of every command as of every other, drawn with the seed."""
    rng = random.Random(SEED)
    groups: dict[str, list[str]] = {}
    for name in cases():
        if not name.endswith(("fifo", "endless-device")):  # where these fail, they take the whole time limit
            groups.setdefault(name.split("-")[0], []).append(name)
    for names in groups.values():
        rng.shuffle(names)
    chosen: list[str] = []
    while len(chosen) < ORDINARY:
        chosen += [names.pop() for names in groups.values() if names]
    return [name for name in cases() if name in chosen[:ORDINARY]]


def _some(faults: Sequence[Fault], count: int, reading: Reading) -> list[Fault]:
    rng = random.Random(zlib.crc32(f"{SEED} {reading.name} {reading.file}".encode()))
    return list(faults) if count >= len(faults) else rng.sample(list(faults), count)


def _every(
    readings: Iterable[Reading], faults: Sequence[Fault], count: int = 10**6, *, numbers: Sequence[int] = (0,)
) -> list[Case]:
    """Cases of `count` of the faults, another choice for each reading; each as often as there are numbers."""
    return [
        case_of(reading, fault, number)
        for reading in readings
        for fault in _some(faults, count, reading)
        for number in numbers
    ]


def _of_files() -> list[Case]:
    bytes_of_any = (*bytes_.WHOLE, *bytes_.PARTS)
    return [
        # the first command of each kind of file meets all faults, the others some
        *_every(r.CLIPS[:1], (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS)),
        *_every((r.CLIPS[0], r.MAPS[0], r.MODELS[0]), bytes_.PARTS, numbers=(1, 2, 3)),
        *_every(r.CLIPS[1:], (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS), 8),
        *_every(r.MAPS[:1], (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS)),
        *_every(r.MAPS[1:], (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS), 10),
        *_every(r.OTHER_NPZ, (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS), 12),
        *_every([r.EXR], (*bytes_of_any, *images.HEADERS, *images.IMAGES)),
        *_every(r.SET_ROOT, (*jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS, *bytes_of_any), 6),
        *_every(r.SET_CLIP, (*jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS), 12),
        *_every(r.SET_ARRAY, (*jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS), 12),
        *_every(r.SET_CHUNK, bytes_of_any, 4),
        *_every(r.SET_REJECTED, (*jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS, *bytes_of_any), 10),
        *_every(r.SET_ZIP[:1], bytes_of_any),
        *_every(r.SET_ZIP[1:], bytes_of_any, 6),
        *_every(r.MIGRATE[:3], (*jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS), 9),
        *_every(r.MIGRATE[3:], bytes_of_any, 6),
        *_every(r.MODELS[:1], (*bytes_of_any, *jsons.HEADER_FAULTS, *jsons.SETTING_FAULTS)),
        *_every(r.MODELS[1:], (*bytes_of_any, *jsons.HEADER_FAULTS), 12),
        *_every(
            [r.RESUME["state.safetensors"]], (*bytes_of_any, *jsons.HEADER_FAULTS, *jsons.SETTING_FAULTS), 30
        ),
        *_every([r.RESUME["config.yaml"]], (*bytes_of_any, *texts.YAML_FAULTS, *texts.WORD_FAULTS), 24),
        *_every([r.RESUME["log.jsonl"]], (*bytes_of_any, *jsons.LINE_FAULTS, *jsons.WHOLE_FAULTS)),
        *_every(r.YAMLS, (*texts.YAML_FAULTS, *bytes_.WHOLE)),
        *_every(r.YAMLS, (*texts.WORD_FAULTS, *texts.LINE_FAULTS, *bytes_.PARTS), 6),
        *_every([r.MOTION], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS)),
        *_every([r.MOTION], (*bytes_.PARTS, *texts.WORD_FAULTS, *texts.LINE_FAULTS), numbers=(1, 2)),
        *_every([r.DRESSED_BVH], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS), 16),
        *_every(r.MESHES[:1], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS)),
        *_every(r.MESHES[1:], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS), 10),
        *_every(r.FRAMES, (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS), 8),
        *_every(r.BINARY_MESHES, bytes_of_any, 10),
        *_every([r.TEXT_PLY], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS)),
        *_every([r.GLTF], (*bytes_of_any, *jsons.WHOLE_FAULTS, *jsons.VALUE_FAULTS)),
        *_every([r.GLTF], jsons.VALUE_FAULTS, numbers=(1, 2)),
        *_every(r.CACHES, bytes_of_any, 12),
        *_every(r.SCENES[:3], bytes_of_any),
        *_every(r.SCENES[:3], bytes_.PARTS, numbers=(1, 2)),
        *_every(r.SCENES[3:], bytes_of_any, 6),
        *_every(r.TEXT_SCENES, (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS)),
        *_every(r.MATERIALS, bytes_of_any, 8),
        *_every([r.PINS], (*bytes_of_any, *texts.WORD_FAULTS, *texts.LINE_FAULTS), 20),
        *_every(r.REPORTS, bytes_of_any, 8),
        *_every(r.PICKLED, (*pickles.PICKLES, *pickles.ENTRIES, *bytes_of_any), 30),
        *_every(r.PUBLIC_NPZ, (*bytes_of_any, *npz.STRUCTURE, *npz.ARRAYS), 12),
        *_every(r.PUBLIC_NPY, (*bytes_of_any, *pickles.NPY), 12),
        *_every(r.PUBLIC_OTHER, (*bytes_of_any, *texts.WORD_FAULTS[:0]), 8),
        *_every([r.PUBLIC_MAT], (*bytes_of_any, *pickles.MAT), 20),
    ]
