"""Every bench runs, and prints the numbers that docs/performance.md quotes. None of them is judged here."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable

import pytest

from scripts.bench import (
    fusion,
    fusion_quality,
    live,
    loader,
    measuring,
    memory,
    predict,
    reading,
    render,
    self_contact,
    simulation,
    store,
    training,
    trunk,
)
from scripts.bench.measuring import Results, Timings, interleaved
from tests.helpers.paths import ROOT

KEYS = {
    "live": {
        "predict_ms",
        "fuse_ms",
        "slider_to_page_ms",
        "ratio_fused_to_read",
        "shape_ms",
        "ratio_shape_to_made",
    },
    "loader": {"share_of_reading_windowed", "share_of_reading_cached", "step_ms_windowed", "step_ms_cached"},
    "trunk": {
        f"{what}_{case}"
        for what in ("step_ms_cached", "step_ms_anew", "ratio_anew_to_cached")
        for case in ("paper", "frozen", "frozen_384")
    },
    "render": {
        "operator_ms",
        "operator_batch_ms",
        "rerasterise_ms",
        "rerasterise_batch_ms",
        "gather_ms",
        "gather_batch_ms",
        "setup_seconds",
        "speedup_over_rerasterising",
        "speedup_over_gather",
        "fraction_of_copy_bandwidth",
        "fraction_of_copy_bandwidth_batch",
        "ratio_torch_sparse_to_ours_backward",
        "ratio_numpy_rasteriser_to_gl",
    },
    "fusion": {
        "speedup",
        "cpu_speedup",
        "rmse_ratio",
        "normal_error_ratio",
        "penetration_percent_before",
        "penetration_percent_after",
        "sdf_ms",
        "truth_edge_strain_percent",
        *(
            f"{solver}_{key}"
            for solver in ("local_global", "adam")
            for key in (
                "seconds_edge",
                "seconds_normal",
                "rmse_mm",
                "normal_degrees",
                "loss_normal",
                "exponent",
            )
        ),
    },
    "fusion_quality": {
        "objective_ratio",
        "rmse_ratio",
        "cpu_speedup",
        "speedup",
        "tshirt_mm",
        "tshirt_rest_mm",
        *(
            f"{solver}_{key}"
            for solver in ("local_global", "adam")
            for key in (
                "objective",
                "longest_edge",
                "rmse_mm",
                "crossing_edges",
                "crossing_most",
                "normal_degrees",
                "cpu_seconds",
                "steps_normal",
            )
        ),
    },
    "self_contact": {
        "truth_percent",
        "cpu_ratio",
        *(
            f"{kind}_{key}"
            for kind in ("without", "with")
            for key in ("percent", "rmse_mm", "longest_edge", "cpu_ms")
        ),
    },
    "memory": {"predict_mb_3", "predict_mb_6", "predict_ratio", "fuse_mb_3", "fuse_mb_6", "fuse_ratio"},
    "predict": {
        "frames",
        "frames_per_second",
        *(f"{command}_frames_per_second" for command in ("predict", "fuse")),
        *(
            f"predict_ms_{stage}"
            for stage in (
                "reading",
                "images",
                "guess",
                "networks",
                "writing_maps",
                "writing_clip",
                "vertices",
                "rest",
            )
        ),
        "fuse_ms_setup",
        "memory_mb_2",
        "memory_mb_10",
        "memory_ratio",
    },
    "reading": {
        *(f"{kind}_{key}" for kind in ("obj", "ply", "glb") for key in ("s", "trimesh_s")),
        *(f"ratio_{kind}_ours_to_fastest" for kind in ("obj", "ply", "glb")),
        *(f"{name}frames_per_s" for name in ("", "trimesh_", "meshio_", "plain_", "long_")),
        *(f"ratio_ours_to_{name}" for name in ("trimesh", "meshio", "plain", "fastest")),
        "short_mb",
        "long_mb",
        "ratio_long_to_short_mb",
    },
    "simulation": {
        "vertices",
        "frames_per_s",
        "p99_stretch",
        "sunk_percent",
        "gates_failed",
        "ratio_newton_to_ours",
        "difference_mm",
        *(f"{stage}_ms" for stage in ("skin", "collider", "start", "contacts", "descent")),
    },
    "store": {
        "write_frames_per_s",
        "frames_per_s_uncached",
        "frames_per_s_windowed",
        "frames_per_s_first",
        "frames_per_s_cached",
        "ratio_cached_to_uncached",
        "trainer_frames_per_s",
        "share_of_step_windowed",
    },
    "training": {
        "step_ms",
        "share_of_maps",
        "share_of_reading_windowed",
        "share_of_reading_cached",
        "ratio_anew_to_cached_paper",
        "ratio_one_to_two_processes",
        "ratio_float32_to_bfloat16",
        "ratio_patch_8_to_16",
        "ratio_fused_to_written_attention",
        "ratio_unchanged_to_channels_last_bfloat16",
        "ratio_svd_to_polar",
        "bfloat16_to_float32",
        "ratio_spinning_to_passive_alone",
        "ratio_spinning_to_passive_beside_one",
        "steps_per_s_spinning_alone",
        "steps_per_s_passive_beside_one",
    },
}
BENCHES = {
    "render": render,
    "fusion": fusion,
    "fusion_quality": fusion_quality,
    "live": live,
    "loader": loader,
    "memory": memory,
    "predict": predict,
    "reading": reading,
    "self_contact": self_contact,
    "simulation": simulation,
    "store": store,
    "training": training,
    "trunk": trunk,
}


SLOW = (
    "live",
    "loader",
    "memory",
    "predict",
    "reading",
    "training",
    "trunk",
)  # they load much, or start processes that do


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in SLOW else name for name in BENCHES]
)
def test_a_quick_run_prints_its_numbers_as_json(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    bench = BENCHES[name]
    measuring.command(bench.__doc__, bench.measure, ["--quick", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert set(found["machine"]) == {"cpu", "cores", "load", "torch", "python"}
    assert found["quick"] is True
    sections = [section for name, section in found.items() if name not in ("machine", "quick")]
    numbers = {key: value for section in sections for key, value in section.items()}
    assert set(numbers) >= KEYS[name]
    assert all(math.isfinite(value) for value in numbers.values())
    assert all(value >= 0 for key, value in numbers.items() if not key.endswith("exponent"))


def test_a_bench_is_found_by_its_path_beside_packages_of_the_same_name() -> None:
    program = [sys.executable, str(ROOT / "scripts" / "bench" / "fusion.py"), "--help"]
    done = subprocess.run(program, capture_output=True, text=True, check=True, cwd=ROOT / "scripts" / "bench")
    assert "--quick" in done.stdout


def test_a_ratio_is_the_median_of_the_rounds_own_ratios() -> None:
    times = Timings({"a": [2.0, 6.0, 40.0], "b": [1.0, 2.0, 10.0]})  # ratios 2, 3, 4
    assert times.ratio("a", "b") == 3
    assert times.ms("a") == 6000


def test_alternatives_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "SAMPLE_SECONDS", 0.0)
    called: list[str] = []
    calls: dict[str, Callable[[], object]] = {name: lambda n=name: called.append(n) for name in "ab"}  # type: ignore[misc]
    interleaved(calls, rounds=3)
    assert called == ["a", "a", "b", "b", *["a", "b"] * 3]  # first call, calibration, then the rounds


def test_the_table_has_a_column_a_section(capsys: pytest.CaptureFixture[str]) -> None:
    def measure(quick: bool) -> Results:
        return {"small": {"some_ms": 1.25, "only_small": 3.0}, "large": {"some_ms": 2.5}}

    measuring.command("", measure, [])
    lines = capsys.readouterr().out.splitlines()
    assert "cpu" in lines[0]
    assert lines[1].split() == ["small", "large"]
    assert lines[3].split() == ["some_ms", "1.25", "2.5"]
    assert lines[4].split() == ["only_small", "3"]
