"""The commands of the README and the pages, run one after another as a reader would; tutorials have their own test.

What they read is small: sample data of six frames a clip, motions of a second, and after a command that trains or
simulates stands how little of it is done here. What cannot be run says why.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from glob import glob
from pathlib import Path

import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import save_clip
from imgtransfer.data.mesh_output import save_obj
from imgtransfer.data.store import DataSet
from scripts.examples import fuse_foreign_maps
from tests.docs.test_readme import PAGES, blocks, commands
from tests.helpers import hub
from tests.helpers.import_examples import standing_body, vest
from tests.helpers.old_data import as_version_1
from tests.helpers.page_files import (
    walk,
    write_clone,
    write_coat,
    write_motions,
    write_vto,
    write_walk,
    write_walk_scene,
)
from tests.helpers.paths import ROOT
from tests.helpers.viewing import running

_LONGEST_S = 300

#: Why a line is not run.
NOT_RUN = {
    "scripts/demo": "tests/imgtransfer/demo runs what it runs",
    "scripts/test": "it runs the tests",
    "source .venv/bin/activate": "of the shell that it is typed in",
    "--ray HEAD:6379": "takes a cluster and the AMASS data; tests/docs/test_tutorials.py begins a cluster",
    "https://host": "nobody has it; tests/imgtransfer/data/test_store_remote.py serves one",
    "train configs/paper.yaml --out RUN": "fetches weights from the hub; the line after it has them in a folder",
}

#: Those that any line with them has.
WITHIN = ("--ray HEAD:6379", "https://host")

_TINY = (
    "maps.size=[32,32] training.batch_frames=2 training.validate_every_steps=1 training.checkpoint_every_steps=1 "
    "training.precision=float32 data.validation_frames=2"
)
_STEPS = f"{_TINY} training.steps=2 network.encoder.patch=8"
_NO_EXTRAS = "pictures=0 played=0"


def _sets(changes: str) -> str:
    return "".join(f" --set {change}" for change in changes.split())


#: What is added to a line, by how it begins: the first that fits.
ADDED = {
    "train configs/demo.yaml": _sets(_STEPS),
    "train configs/general.yaml --init configs/general --data FOLDER": _sets(
        "training.precision=float32 data.validation_frames=2 network.head.support=20 network.head.patches=3"
    ),
    "train configs/general.yaml": _sets(_STEPS),
    "train configs/external.yaml": _sets(_TINY),
    "train configs/pretrain.yaml": _sets(_TINY),
    "train configs/paper.yaml": _sets(_TINY.replace("32,32", "64,64") + " training.steps=2"),
    "simulate configs/data/sample.yaml --template": " --clip '*/walk*' --frames 3",
    "simulate configs/data/sample.yaml --clip": " --frames 3",
    "simulate configs/data/sample.yaml": " --clip 'skirt/walk*' --clip 'dress/walk*' --frames 3",
    "simulate configs/data/general.yaml": " --clip '*walk_s700*' --clip '*twist_s700*' --frames 3",
    "simulate configs/data/general_bodies.yaml": " --clip '*walk_s800*' --clip '*twist_s800*' --frames 3",
    "simulate configs/data/general_leaning.yaml": " --clip '*lean_s900*' --clip '*lean_s940*' --frames 3",
    "simulate configs/data/general_swinging.yaml": " --clip '*lean_s1000*' --clip '*kick_s1000*' --frames 3",
    "simulate configs/data/pretrain.yaml": " --clip '*walk_s1' --clip '*twist_s91' --frames 3",
    "simulate walk": " --frames 3",
    "benchmark configs/benchmark/sample.yaml --methods": _sets(_NO_EXTRAS),
    "benchmark": " --methods lbs" + _sets(_NO_EXTRAS),
    "ablate": _sets("seeds=[0] method.maps.size=[32,32] method.training.steps=2"),
    "dress walk.npz": " --frames 0:2",
}


def _readme() -> None:
    write_motions()
    write_walk(Path("walk"), in_centimetres=True)
    old = DataSet.create(Path("old.zarr"))
    old.write("dress/walk", walk(), split="train")
    as_version_1(old)
    _own_maps()


def _own_maps() -> None:
    """shirt.obj, maps.npz, body.npz: of a garment in motion."""
    save_clip(Path("body.npz"), walk())
    assert main(["export", "body.npz", "--out", "frames"]) == 0
    shutil.copy("frames/template.obj", "shirt.obj")
    assert main(["render", "body.npz", "--size", "64", "--out", "rendered"]) == 0
    shutil.copy(next(Path("rendered").rglob("garment.npz")), "maps.npz")


def _index() -> None:
    write_motions()
    _own_maps()
    Path("walk").mkdir()
    for file in Path("frames").glob("garment_*.obj"):
        shutil.copy(file, "walk")


def _write_data(path: Path) -> None:
    """A data set with both splits that a training needs."""
    data = DataSet.create(path)
    for split in ("train", "validation"):
        data.write(f"dress/{split}", walk(frames=6), split=split)


def _made_for_the_shape() -> None:
    shutil.copy("seed7/template.obj", "coat.obj")


def _predicted() -> None:
    """predictions: of two clips, fused."""
    words = (
        "predict configs/general configs/sample_data/tshirt.zarr.zip --split test --fuse --out predictions"
    )
    assert main(words.split()) == 0


def _maps() -> None:
    _index()
    save_clip(Path("truth.npz"), walk())
    save_clip(Path("prediction.npz"), walk().with_garment(walk().garment.vertices + 0.01))  # type: ignore[union-attr]


def _importing() -> None:
    """Frames in centimetres with z up beside rest poses in metres, at first."""
    _rest_in_metres()
    write_coat("shirt.obj", z_up=False)
    write_walk_scene(Path("walk.usd"), garment="Shirt", body="Avatar")
    write_vto(Path())
    Path("my_clips").mkdir()
    save_clip(Path("my_clips/coat.npz"), walk())


def _rest_in_metres() -> None:
    write_walk(Path("walk"), in_centimetres=True)
    write_walk(Path("metres"))
    for name in ("template.obj", "body_rest.obj"):
        shutil.copy(Path("metres") / name, "walk")


def _in_metres() -> None:
    shutil.rmtree("walk")
    for name in ("walk", "run"):
        write_walk(Path(name))


def _in_centimetres() -> None:
    for name in ("walk", "run"):
        shutil.rmtree(name)
        write_walk(Path(name), in_centimetres=True)
    write_coat("shirt.obj", z_up=True)


def _data() -> None:
    write_coat("coat.obj", z_up=True)
    for name in ("SMALL.zarr", "DATA.zarr"):
        _write_data(Path(name))
    write_walk(Path("frames"))
    Path("walk/body").mkdir(parents=True)
    for file in Path("frames").glob("body_0*.obj"):
        shutil.copy(file, "walk/body")
    shutil.copy("frames/body_rest.obj", "walk")


def _own_axes_and_units() -> None:
    save_obj(Path("coat.obj"), vest(standing_body()))


def _training() -> None:
    """FOLDER: clips by the names of the external ones, and an encoder's files."""
    for name in ("vb1_a", "vb2_a", "vb3_a", "cmu_a"):
        save_clip(Path(f"FOLDER/tshirt_{name}.npz"), walk(frames=6))
    assert main(["import", "configs/sample_data/tshirt.zarr.zip", "--to", "DATA.zarr"]) == 0
    hub.checkpoint(Path("ENCODER"))


def _external() -> None:
    for name in ("tshirt_vb1_60", "tshirt_vb2_a", "tshirt_vb3_a", "dress_vb2", "dress_vb3"):
        save_clip(Path(f"CLIPS/{name}.npz"), walk(frames=6))


def _general() -> None:
    write_motions()
    Path("MOTIONS").mkdir()
    shutil.copy("walk.npz", "MOTIONS")


def _pretrained() -> None:
    return


def _fusion() -> None:
    fuse_foreign_maps.example(Path("fusion-example"), quick=True)


#: What a page's reader has besides a clone.
GIVEN: dict[str, Callable[[], None]] = {
    "README.md": _readme,
    "configs/general/README.md": _general,
    "configs/pretrained/README.md": _pretrained,
    "configs/sample_data/README.md": _pretrained,
    "docs/benchmark.md": _pretrained,
    "docs/blender.md": _predicted,
    "docs/data.md": _data,
    "docs/dressing.md": write_motions,
    "docs/fusion.md": _fusion,
    "docs/importing.md": _importing,
    "docs/index.md": _index,
    "docs/maps.md": _maps,
    "docs/results.md": _external,
    "docs/training.md": _training,
    "docs/viewing.md": _predicted,
}

#: What the reader has besides from a line on.
BEFORE = {
    "dress walk.npz --garment coat.obj --weld --body seed:7 --out coat.abc": _made_for_the_shape,
    "import meshes walk --to my_data.zarr --split train --garment shirt": _in_metres,
    "simulate walk/ --template coat.obj --out COAT.zarr": _own_axes_and_units,
    "simulate walk run --template shirt.obj --unit=cm --up=z --weld --out mine.zarr": _in_centimetres,
}

#: What stands for something else on the page at another line.
RENAMED = {
    "train configs/demo.yaml --out RUN --resume": {"RUN": "runs/demo"},
    "train configs/external.yaml --data FOLDER --out RUN": {"RUN": "EXTERNAL"},
    "train configs/demo.yaml --init OTHER_RUN --data DATA.zarr --out RUN": {"OTHER_RUN": "runs/demo"},
    "train configs/paper.yaml --out RUN --set network.encoder.name=FOLDER": {
        "network.encoder.name=FOLDER": "network.encoder.name=ENCODER",
        "RUN": "paper",
    },
    "export skirt.zarr --out configs/sample_data/skirt.zarr.zip": {
        "configs/sample_data/skirt.zarr.zip": "skirt.zarr.zip"
    },
}


Line = list[str]  # words, the program first


def lines_of(page: str) -> list[Line]:
    """A page's commands, of a loop those of one garment; ours without the program."""
    lines = commands(blocks((ROOT / page).read_text(encoding="utf-8")))
    lines = [[word.replace("$garment", "skirt") for word in words] for words in lines]
    return [words[1:] if words[0] == "imgtransfer" else words for words in lines]


def reason(words: Line) -> str | None:
    """Why a line is not run; None where it is."""
    line = " ".join(words)
    return next(
        (why for part, why in NOT_RUN.items() if line == part or (part in WITHIN and part in line)), None
    )


def as_run(words: Line) -> Line:
    """A line with the names that stand for something else, patterns as the shell expands them, and little to do."""
    line = " ".join(words)
    others = RENAMED.get(line, {})
    renamed = [others.get(word, word) for word in words]
    added = next((more for start, more in ADDED.items() if line.startswith(start)), "")
    return renamed + shlex.split(added)


def run(words: Line) -> None:
    """Run one line.

    A page in the browser is opened and ended, a program run by this Python, and ours in this process.
    """
    if words[0] == "view":
        return look_at(words[1:])
    if Path(words[0]).name == "python":
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, *words[1:]], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr[-2000:]
        return
    paths = [sorted(glob(word)) if "/*." in word and words[0] == "ablate" else [word] for word in words]
    assert main([word for some in paths for word in some]) == 0


def look_at(words: Line) -> None:
    """Serve a page, fetch it, and end it by Ctrl-C."""
    with running(*words) as (process, address):
        with urllib.request.urlopen(address, timeout=_LONGEST_S) as answer:
            assert b"<html" in answer.read().lower()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=_LONGEST_S)
    assert process.returncode == 130
    assert said == "imgtransfer: stopped\n"


def test_the_lines_of_every_page_are_run() -> None:
    with_lines = {
        page for page in ("README.md", *map(str, PAGES)) if lines_of(page) and "tutorials" not in page
    }
    assert with_lines == set(GIVEN)


def test_everything_that_is_said_of_lines_is_said_of_one() -> None:
    whole = [" ".join(words) for page in GIVEN for words in lines_of(page)]
    for line in (*NOT_RUN, *BEFORE, *RENAMED):
        assert line in whole or (line in WITHIN and any(line in one for one in whole)), line
    for start in ADDED:
        assert any(line.startswith(start) for line in whole), start


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clone(tmp_path_factory.mktemp("clone") / "imgtransfer")


@pytest.mark.long
@pytest.mark.parametrize("page", GIVEN)
def test_the_lines_of_a_page_run(
    page: str, clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for entry in clone.iterdir():
        (tmp_path / entry.name).symlink_to(entry)
    monkeypatch.chdir(tmp_path)
    GIVEN[page]()
    for words in lines_of(page):
        if reason(words) is None:
            BEFORE.get(" ".join(words), lambda: None)()
            run(as_run(words))
