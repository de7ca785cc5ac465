"""Clips that another simulator made, imported, rendered, fused and measured.

They lie outside this repository, in ../shared/external, because their licence forbids passing them on.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from imgtransfer.cli.main import main
from imgtransfer.data.clip import load_clip, save_clip
from tests.helpers.paths import EXTERNAL


@pytest.mark.skipif(not (EXTERNAL / "unpack.py").is_file(), reason=f"no external clips at {EXTERNAL}")
def test_a_t_shirt_of_another_simulator_is_imported_rendered_fused_and_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "packed").mkdir()
    shutil.copy(EXTERNAL / "tshirt_vb3_40.npz", tmp_path / "packed")
    unpack = [sys.executable, str(EXTERNAL / "unpack.py"), f"{tmp_path}/npz", f"{tmp_path}/packed"]
    subprocess.run(unpack, check=True, capture_output=True)
    clip = load_clip(tmp_path / "npz/tshirt_vb3_40.npz")
    assert (clip.n_frames, len(clip.template.vertices)) == (75, 4424)
    save_clip(tmp_path / "tshirt_dance.npz", clip.slice(slice(0, 75, 25)))

    data, maps, fused = (str(tmp_path / name) for name in ("data", "maps", "fused"))
    assert main(["import", f"{tmp_path}/tshirt_dance.npz", "--to", data, "--split", "test"]) == 0
    assert main(["render", data, "--out", maps]) == 0
    folder = "tshirt__dance"
    fuse = ["fuse", "--maps", f"{maps}/{folder}/garment.npz", "--body", f"{tmp_path}/tshirt_dance.npz"]
    assert main([*fuse, "--out", f"{fused}/{folder}"]) == 0

    found = {}
    for name, what in (("fused", [fused]), ("lbs", ["--baseline", "lbs"])):
        capsys.readouterr()
        assert main(["evaluate", *what, "--truth", data, "--json"]) == 0
        found[name] = json.loads(capsys.readouterr().out)["overall"]
    assert 25 < found["lbs"]["rmse_mm"] < 40  # as the clips' README says: 27 to 37 mm
    assert found["fused"]["rmse_mm"] < 5  # from true maps; two runs of the simulator differ by 4.2 mm
    assert found["fused"]["sted"] < found["lbs"]["sted"]
    assert found["fused"]["penetration_percent"] <= 0.5
