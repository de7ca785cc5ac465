"""What there is to look at, and what belongs together."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from imgtransfer.data.clip import save_clip
from imgtransfer.viewing.clip_motion import ClipMotion
from imgtransfer.viewing.sources import Showing, open_sources, truth_of
from render import InputError
from tests.helpers.synthetic import tube_clip


def titles(showings: tuple[Showing, ...]) -> list[str]:
    return [showing.title for showing in showings]


def test_predictions_stand_beside_the_clips_that_they_are_of(data: Path, predictions: Path) -> None:
    clips = open_sources([data, predictions])
    assert list(clips) == ["tube/a", "tube/b"]
    assert titles(clips["tube/a"]) == ["data.zarr", "method, fused", "method, position only"]
    assert titles(clips["tube/b"]) == ["data.zarr", "method, position only"]
    truth = truth_of(clips["tube/a"])
    assert truth is not None
    assert truth.title == "data.zarr"
    assert truth_of(open_sources([predictions])["tube/a"]) is None


def test_folders_of_one_name_are_told_apart(predictions: Path, tmp_path: Path) -> None:
    other = tmp_path / "second" / "method"
    shutil.copytree(predictions, other)
    shown = open_sources([predictions, other], ["tube/b"])["tube/b"]
    assert titles(shown) == [f"{predictions}, position only", f"{other}, position only"]


def test_one_clips_folder_is_called_as_its_clip(predictions: Path) -> None:
    assert list(open_sources([predictions / "tube__b"])) == ["tube/b"]


def test_clips_are_chosen_by_name(data: Path, predictions: Path) -> None:
    assert list(open_sources([data, predictions], ["*/b"])) == ["tube/b"]
    with pytest.raises(InputError, match=r"no clip matches \(names none\); there are tube/a, tube/b"):
        open_sources([predictions], ["none"])


def test_a_folder_with_neither_clips_nor_predictions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither a data set"):
        open_sources([tmp_path])


def test_a_prediction_is_measured_against_the_truth(data: Path, predictions: Path) -> None:
    clip, fused, _ = open_sources([data, predictions])["tube/a"]
    motion = ClipMotion(fused, clip)
    values = motion.dress.values(motion.frame(3), "error")
    assert values is not None
    assert values == pytest.approx(20.0, abs=1e-3)  # millimetres
    own = ClipMotion(clip, clip)  # of the truth itself nothing is measured
    assert own.dress.values(own.frame(3), "error") is None


def test_a_truth_of_another_garment_is_refused(data: Path, tmp_path: Path) -> None:
    save_clip(tmp_path / "p" / "tube__a" / "fused.npz", tube_clip(2, rings=8))
    clip, fused = open_sources([data, tmp_path / "p"], ["tube/a"])["tube/a"]
    with pytest.raises(InputError, match="another garment"):
        ClipMotion(fused, clip)
