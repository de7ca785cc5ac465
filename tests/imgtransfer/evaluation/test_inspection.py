"""What a clip's inspection measures, and that each known fault is named where it is, and a good clip is not."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import Clip
from imgtransfer.data.clip_parts import Garment
from imgtransfer.data.store import DataSet
from imgtransfer.evaluation.inspection import inspect_clip
from imgtransfer.report.svg import line_plot
from tests.helpers import synthetic
from tests.helpers.pages import check_page

FRAMES, FAULTY = 40, 20


@pytest.fixture(scope="module")
def clip() -> Clip:
    return synthetic.tube_clip(FRAMES)


def spoilt(clip: Clip, change: Callable[[np.ndarray], object]) -> Clip:
    assert clip.garment is not None
    garment = clip.garment.vertices.copy()
    change(garment)
    return clip.with_garment(garment)


def test_a_good_clip_has_no_findings(clip: Clip) -> None:
    found = inspect_clip(clip)
    assert found.findings == ()
    assert found.strain.shape == (FRAMES, 3)
    assert found.speed.shape == (FRAMES - 1, 2)
    assert len(found.sampled) == len(found.inside) == len(found.farthest) == len(found.slid) == 24
    assert found.inside.max() == 0
    assert len(found.crossing) == len(found.self_crossing) == 24
    assert found.crossing.max() == found.self_crossing.max() == 0


def test_measures_by_hand(clip: Clip) -> None:
    garment = np.stack([clip.template.vertices * np.float32(1.5)] * 3)
    garment[1] += np.float32([0, 0.02, 0])  # 2 cm up and down again, at 30 frames a second: 0.6 m/s
    body = np.repeat(clip.body.vertices[:1], 3, 0)
    found = inspect_clip(
        replace(
            clip,
            body=replace(clip.body, vertices=body),
            garment=Garment(garment),
            skeleton=replace(clip.skeleton, poses=None, trans=None),
        )
    )
    np.testing.assert_allclose(found.strain, 50, atol=1e-3)  # all edges are half as long again
    np.testing.assert_allclose(found.speed, [[0.6, 0], [0.6, 0]], atol=1e-5)
    assert found.jitter_mm == pytest.approx(40, abs=1e-3)  # |x0 - 2 x1 + x2| is twice 2 cm


def jump(garment: np.ndarray) -> None:
    garment[FAULTY:] += np.float32([0, 0, 0.2])


def stretch(garment: np.ndarray) -> None:
    garment[FAULTY] = garment[FAULTY].mean(0) + 2 * (garment[FAULTY] - garment[FAULTY].mean(0))


def one_edge(garment: np.ndarray) -> None:
    garment[FAULTY, 5] += np.float32([0, 0.5, 0])


def sink(garment: np.ndarray) -> None:
    middle = garment[FAULTY:].mean(1, keepdims=True)
    garment[FAULTY:] = middle + (garment[FAULTY:] - middle) * np.float32([0.6, 1, 0.6])


def lean(garment: np.ndarray) -> None:
    garment[FAULTY:] += np.float32([0.06, 0, 0])


def slide(garment: np.ndarray) -> None:
    garment[:, :, 1] -= np.linspace(0, 0.45, FRAMES, dtype=np.float32)[:, None]


def freeze(garment: np.ndarray) -> None:
    garment[FAULTY] = garment[FAULTY - 1]


FAULTS = {
    jump: "sudden jumps of the garment, the first before frame 20",
    stretch: r"1 % of the edges are stretched or pressed by more than \d+ % in frame 20",
    one_edge: r"an edge is [\d.]+ times as long in frame 20",
    sink: r"[\d.]+ % of the vertices are inside the body in frame",
    lean: r"edges of cloth and body, [\d.]+ % of the garment's, pass through the other in frame",
    slide: r"the garment has slid: half of it by more than 0.\d\d m in frame 39",
    freeze: "1 frames repeat the garment of the frame before",
}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_is_named(clip: Clip, fault: Callable[[np.ndarray], object]) -> None:
    texts = [finding.text for finding in inspect_clip(spoilt(clip, fault)).findings]
    assert any(re.search(FAULTS[fault], text) for text in texts), texts


def test_jitter_counts_only_while_the_body_rests(clip: Clip) -> None:
    noise = np.random.default_rng(0).normal(0, 0.001, clip.garment.vertices.shape).astype(np.float32)
    moving = inspect_clip(clip.with_garment(clip.garment.vertices + noise))
    assert moving.jitter_mm is None
    still = replace(
        clip,
        body=replace(clip.body, vertices=np.repeat(clip.body.vertices[:1], FRAMES, 0)),
        skeleton=replace(clip.skeleton, poses=None, trans=None),
    ).with_garment(clip.garment.vertices[:1] + noise)
    (finding,) = inspect_clip(still).findings
    assert finding.text.startswith("jitters by 3.")  # sqrt(6) mm an axis, 3.9 mm in space


def test_faults_of_the_meshes_are_named(clip: Clip) -> None:
    centimetres = replace(
        clip, template=replace(clip.template, vertices=clip.template.vertices * 100), garment=None
    )
    assert "the template is 60 m high, the body 1 m: other units?" in _texts(centimetres)
    aside = replace(
        clip, template=replace(clip.template, vertices=clip.template.vertices + np.float32([2, 0, 0]))
    )
    assert "from the resting body: not in the same place?" in _texts(aside)
    inside = replace(
        clip, template=replace(clip.template, vertices=clip.template.vertices * np.float32([0.7, 1, 0.7]))
    )
    assert "100.0 % of the template's vertices are inside the resting body" in _texts(inside)
    twice = np.concatenate([clip.template.vertices, clip.template.vertices[:2]])
    seams = replace(clip, template=replace(clip.template, vertices=twice), garment=None)
    assert "2 of the template's vertices belong to no face" in _texts(seams)
    assert "2 of the template's vertices stand where another does: unwelded seams?" in _texts(seams)


def _texts(clip: Clip) -> str:
    return "; ".join(finding.text for finding in inspect_clip(clip).findings)


def test_a_clip_of_one_frame_or_without_a_garment(clip: Clip) -> None:
    assert inspect_clip(clip.slice(slice(0, 1))).findings == ()
    bare = inspect_clip(replace(clip, garment=None))
    assert (len(bare.strain), bare.findings) == (0, ())


# the page


def test_the_page_shows_every_clip_and_names_the_faulty_ones(
    tmp_path: Path, clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    data = DataSet.create(tmp_path / "set", title="Tubes <3", licence="CC0-1.0")
    data.write("tube/good", clip, split="train")
    data.write("tube/jump", spoilt(clip, jump), split="test")
    page = tmp_path / "page.html"
    assert main(["inspect", str(tmp_path / "set"), "--html", str(page), "--workers", "2"]) == 0
    assert "1 of 2 clips to look at" in capsys.readouterr().out
    text = page.read_text()
    assert text.count("data:image/jpeg;base64,") == 2
    assert text.count("<svg") == 4
    assert "Tubes &lt;3" in text
    assert "<script" not in text
    assert "http" not in text.replace("http-equiv", "")  # nothing from elsewhere
    looked_at = text.partition("To look at: 1 of 2 clips")[2].partition("</section>")[0]
    assert "tube/jump" in looked_at
    assert "tube/good" not in looked_at
    assert len(text) < 300_000
    check_page(page)


def test_a_damaged_clip_is_on_the_page_beside_the_others(
    tmp_path: Path, clip: Clip, capsys: pytest.CaptureFixture[str]
) -> None:
    data = DataSet.create(tmp_path / "set")
    for name in ("good", "lost"):
        data.write(f"tube/{name}", clip, split="train")
    (tmp_path / "set/tube/lost/garment_vertices/c/1/0/0").unlink()
    page = tmp_path / "page.html"
    assert main(["inspect", str(tmp_path / "set"), "--html", str(page)]) == 2
    captured = capsys.readouterr()
    assert "1 of 2 clips cannot be read" in captured.err
    assert captured.err.count("\n") == 1
    assert "chunk 1 is missing" in page.read_text()
    assert page.read_text().count("<svg") == 2


def test_a_plot_is_short_and_keeps_the_peaks() -> None:
    y = np.zeros(5000)
    y[1234] = 7.0
    plot = line_plot({"a & b": (np.arange(5000) / 30, y)}, title="speed, m/s", x_label="s", marks=[3.0])
    assert len(plot) < 8000
    assert "a &amp; b" in plot
    top = min(float(point.split(",")[1]) for point in plot.partition('points="')[2].split('"')[0].split())
    assert top == pytest.approx(210 - 34 - 7 / 8 * (210 - 34 - 30), abs=0.1)
    assert "<svg" in line_plot({"empty": ([], [])}, title="", x_label="")
