"""A figure whose cloth is simulated: what its gates refuse, and what is told meanwhile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from imgtransfer.dressing.simulated import simulate_source
from imgtransfer.dressing.source import open_source
from imgtransfer.simulation.config import GateConfig
from render import InputError
from tests.helpers.amass_files import write_amass
from tests.helpers.simulations import short


def test_a_garment_that_fails_its_gates_is_refused_in_one_line_and_kept_where_asked(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_amass(tmp_path / "walk.npz")
    config = short(gates=GateConfig(p99_stretch=0.5, crossing_percent=10))
    source = open_source(tmp_path / "walk.npz", config, frames=slice(4, 7))
    told: list[tuple[str, int, int]] = []
    with pytest.raises(InputError) as refused:
        simulate_source(source, config, progress=lambda *said: told.append(said))
    assert str(refused.value).startswith("walk: rejected after two attempts: p99_stretch is ")
    assert str(refused.value).endswith("at most 0.5 allowed (anyway=True keeps it all the same)")
    expected = [("settling", 0, 3)]
    for again in ("", ", finer"):
        warmed = [(f"warming up{again}", number, 3) for number in (1, 2)]
        expected += [*warmed, *((f"simulating{again}", number, 3) for number in (1, 2, 3))]
    assert told == expected
    clip, quality = simulate_source(source, config, anyway=True)
    assert clip.n_frames == 3
    assert clip.garment is not None
    assert np.isfinite(clip.garment.vertices).all()
    assert quality.p99_stretch > 0.5
    assert "note: walk: p99_stretch is " in caplog.text
