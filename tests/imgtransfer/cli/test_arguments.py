"""Arguments that nobody means: each is refused by its own option, before any work."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip, save_clip


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["render", "clip.npz", "--out", "o", "--size", "²"], "--size ²"),
        (["render", "clip.npz", "--out", "o", "--size", "٣٢"], "--size ٣٢"),
        (["render", "clip.npz", "--out", "o", "--size", "1000000"], "at most 8192 pixels a side"),
        (["render", "clip.npz", "--out", "o", "--size", "9" * 5000], "at most 8192 pixels a side"),
        (["render", "clip.npz", "--out", "o", "--size", "32x0"], "--size 32x0"),
        (["render", "clip.npz", "--out", "o", "--size", "32", "--layers", "100000"], "1 to 64 layers"),
        (["render", "clip.npz", "--out", "o", "--layers", "²"], "--layers: a whole number from 1 on is wanted"),
        (["render", "clip.npz", "--out", "o", "--size", "32", "--views", "ring:100000"], "from 1 to 360"),
        (["render", "clip.npz", "--out", "o", "--size", "32", "--views", "nan/0"], "'nan/0'"),
        (["render", "clip.npz", "--out", "o", "--frames", "9" * 5000], "--frames"),
        (["render", "clip.npz", "--out", "o", "--frames", "²"], "--frames"),
        (["render", "a.obj", "--template", "a.obj", "--out", "o", "--fps", "nan"], "--fps: fps is nan"),
        (["render", "a.obj", "--template", "a.obj", "--out", "o", "--fps", "inf"], "--fps: fps is inf"),
        (["import", "meshes", "x", "--to", "o", "--fps", "nan"], "--fps nan"),
        (["import", "meshes", ".", "--to", "o", "--scale", "inf"], "--scale"),
        (["inspect", "clip.npz", "--html", "p.html", "--workers", "1000000000"], "--workers 1000000000"),
        (["fuse", "p", "--erode", "1000000000"], "--erode 1000000000"),
        (["fuse", "p", "--device", "meta"], "--device meta"),
        (["fuse", "p", "--device", "cuda:99"], "--device cuda:99"),
        (["fuse", "p", "--device", "abacus"], "--device abacus"),
        (["render", "clip.npz", "--size", "32", "--out", "a\0b"], "null character"),
        (["render", "n" * 5000, "--out", "o"], "name too long"),
        (["render", "clip.npz", "--size", "32", "--out", "clip.npz"], "clip.npz"),
    ],
)  # fmt: skip
def test_arguments_that_nobody_means(  # noqa: PLR0917
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tube_clip: Clip,
    argv: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    save_clip("clip.npz", tube_clip)
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    try:
        status = main(argv)
    except SystemExit as stopped:  # argparse's way
        status = int(str(stopped.code))
    error = capsys.readouterr().err
    assert status == 2
    assert message.casefold() in error.casefold()
    assert "Traceback" not in error
    assert not Path("o").exists() or not list(Path("o").iterdir())


def test_a_clip_that_mirrors_joints_or_is_far_away_is_refused(tube_clip: Clip) -> None:
    from dataclasses import replace  # noqa: PLC0415

    from render import InputError  # noqa: PLC0415

    far = tube_clip.body.vertices.copy()
    far[2, 3, 1] = 2e4
    with pytest.raises(InputError, match=r"body_vertices: frame 2, vertex 3 is .* beyond ±10000 m"):
        replace(tube_clip, body=replace(tube_clip.body, vertices=far))
    mirrors = np.tile(np.eye(3, 4, dtype=np.float32), (tube_clip.n_frames, 2, 1, 1))
    mirrors[1, 0, 2, 2] = -1
    with pytest.raises(InputError, match="joint_transforms: that of frame 1, joint 0 mirrors"):
        replace(tube_clip, skeleton=replace(tube_clip.skeleton, joint_transforms=mirrors))
    with pytest.raises(InputError, match="fps is inf"):
        replace(tube_clip, fps=np.inf)
