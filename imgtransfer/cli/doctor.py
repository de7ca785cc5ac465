"""`imgtransfer doctor`: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import argparse
import platform
from importlib.metadata import PackageNotFoundError, version

from imgtransfer.cli.machine import number_types, threads, vector_units
from render import InputError

OPTIONAL = {  # what for, and the extra of this project that installs it
    "newton": ("cloth simulation (`imgtransfer simulate`)", "simulate"),
    "alembic3d": ("meshes in Alembic files (.abc)", "alembic"),
    "usd-core": ("meshes in USD files (.usd, .usda, .usdc, .usdz)", "usd"),
    "anny": ("the Anny body model, to rebuild the body mesh", "bodies"),
}
CORE = (
    "imgtransfer",
    "numpy",
    "scipy",
    "zarr",
    "trimesh",
    "moderngl",
    "opencv-contrib-python-headless",
    "kornia",
)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the command's arguments (none)."""
    parser = subparsers.add_parser(
        "doctor",
        help="report what works on this machine",
        description="GL, PyTorch, what the processor does well (vector units, number types, threads), Warp, optional "
        "parts, versions. Exit status 0 when it can be used.",
        examples=("imgtransfer doctor", "imgtransfer doctor > machine.txt"),
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Print one line a part; what is missing says how to get it.

    Raises:
        InputError: something without which nothing works is missing.
    """
    del args
    print(f"{'python':10} {platform.python_version()} on {platform.system()}")
    broken = [part() for part in (_gl, _torch, _warp)]
    for package, (use, extra) in OPTIONAL.items():
        missing = f"missing: {use}; in the project's folder: pip install -c constraints.txt -e '.[{extra}]'"
        print(f"{package:10} {_version(package) or missing}")
    versions = [f"{package} {_version(package) or 'missing'}" for package in CORE]
    print(f"{'versions':10} {', '.join(versions)}")
    problems = [problem for problem in broken if problem]
    if problems:
        raise InputError("doctor: " + "; ".join(problems))
    print("ready")


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _gl() -> str | None:
    from render.raster.context import HOW_TO_INSTALL, probe_backends  # noqa: PLC0415

    renderers = probe_backends()
    working = [name for name, renderer in renderers.items() if not renderer.startswith("unavailable")]
    for name, renderer in renderers.items():
        print(f"{'GL':10} {name}: {renderer}")
    if working:
        print(f"{'GL':10} rasterising with {working[0]}")
    else:
        print(f"{'GL':10} rasterising with the slow NumPy reference; to mend this: {HOW_TO_INSTALL['egl']}")
    return None  # the NumPy rasteriser always works


def _torch() -> str | None:
    try:
        import torch  # noqa: PLC0415

        device = f"cuda ({torch.cuda.get_device_name()})" if torch.cuda.is_available() else "cpu"
        length = float(torch.linalg.vector_norm(torch.tensor([3.0, 4.0], device=device.split(maxsplit=1)[0])))
    except (ImportError, OSError, RuntimeError) as error:
        return f"PyTorch does not work ({error}); run scripts/test, which installs it"
    print(f"{'torch':10} {torch.__version__} on {device}")
    print(f"{'vectors':10} {vector_units()}")
    print(f"{'bfloat16':10} {number_types()}")
    print(f"{'threads':10} {threads()}")
    return None if length == 5.0 else f"PyTorch computes |(3, 4)| = {length}; reinstall it"


def _warp() -> str | None:
    try:
        distance = _distance_to_a_tetrahedron()
    except (ImportError, OSError, RuntimeError) as error:
        return f"Warp does not work ({error}); pip install warp-lang"
    print(f"{'warp':10} {_version('warp-lang')}, signed distance works")
    return None if abs(distance - 1.0) < 1e-5 else f"Warp computes a distance of {distance} instead of 1"


def _distance_to_a_tetrahedron() -> float:
    """From (0, 0, −1) to the tetrahedron of the origin and the unit axes, which is 1 m away."""
    import numpy as np  # noqa: PLC0415
    import torch  # noqa: PLC0415

    from fusion import BodySdf  # noqa: PLC0415

    body = BodySdf(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), 4)
    body.update(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32))
    return float(body.query(torch.tensor([[0.0, 0.0, -1.0]])).distance[0])
