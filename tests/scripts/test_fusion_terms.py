"""The table of what each term is worth, on a tiny prediction."""

import json
import shutil

import pytest

from imgtransfer.running.exit import exit_status
from scripts.bench import fusion_terms
from tests.helpers.fusion_examples import write_example


@pytest.fixture(scope="module")
def predictions(tmp_path_factory):
    """A folder as `predict` writes it, of exact maps, and the truth beside it."""
    place = tmp_path_factory.mktemp("terms")
    write_example(place, 2)
    folder = place / "predictions" / "clip"
    folder.mkdir(parents=True)
    shutil.move(place / "maps.npz", folder)
    shutil.copy(place / "clip.npz", folder / "position_only.npz")
    return folder.parent


@pytest.fixture(scope="module")
def found(predictions):
    return fusion_terms.measure(predictions, predictions.parent / "clip.npz")


def test_every_row_is_measured_for_both_solvers(found):
    assert list(found) == ["local_global", "adam"]
    starts = []
    for rows in found.values():
        assert list(rows) == ["initialisation", "+ edge lengths", "+ rendered normals", "full"]
        assert len({values["rmse_mm"] for values in rows.values()}) == 4
        assert rows["+ edge lengths"]["rmse_mm"] < rows["initialisation"]["rmse_mm"]
        assert rows["full"]["penetration_percent"] == 0
        starts.append(rows["initialisation"])
    assert starts[0] == starts[1]  # no solver has done anything yet


def test_the_truth_s_normals_are_those_of_exact_maps(predictions, found, monkeypatch):
    monkeypatch.setattr(fusion_terms, "SOLVERS", ("local_global",))
    true = fusion_terms.measure(predictions, predictions.parent / "clip.npz", true_normals=True)
    assert true["local_global"]["full"] == pytest.approx(found["local_global"]["full"], rel=0.02, abs=0.02)


@pytest.mark.parametrize("form", [[], ["--json"]])
def test_it_prints_a_table_or_json(found, form, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["fusion_terms", "predictions", "--truth", "clip.npz", *form])
    monkeypatch.setattr(fusion_terms, "measure", lambda *_, **__: found)
    fusion_terms.command()
    printed = capsys.readouterr().out
    if form:
        assert json.loads(printed) == found
    else:
        assert len(printed.splitlines()) == 2 + 2 * 4


def test_predictions_that_are_not_there(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["fusion_terms", "nowhere", "--truth", "clip.npz"])
    assert exit_status(fusion_terms.command, program="fusion_terms", stopped="stopped") == 2
    assert "nowhere: no such folder" in capsys.readouterr().err
