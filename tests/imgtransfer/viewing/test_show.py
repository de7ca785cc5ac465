"""What the page shows while something on it cannot be read, without a browser."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from imgtransfer.shipped import shipped_model
from imgtransfer.viewing import LiveControls, Show, open_sources, page_server
from render import InputError
from tests.helpers.viewing import put


def test_the_live_garment_stays_and_moves_while_a_clip_cannot_be_read(data: Path) -> None:
    model = shipped_model("general")
    assert model is not None
    live = LiveControls(model, on=True)
    with page_server("127.0.0.1", 0) as server:
        show = Show(server, open_sources([data]), live)
        put(live._fused, False)
        show.draw()
        assert show._clip is not None
        assert len(show._all()) == 2
        for chunk in (data / "tube/b/garment_vertices").rglob("c/*/*/*"):
            chunk.write_bytes(b"damaged")
        put(show._clip._clip, "tube/b")
        put(live._turns["arms up"], 40)
        show.step()
        (figure,) = show._all()
        posed = live.motion()
        assert posed is not None
        assert posed.now.garment is not None
        assert figure is show._live_figure
        moved = posed.now.body - figure._body.vertices
        np.testing.assert_allclose(figure._cloth.vertices, posed.now.garment - moved[0], atol=1e-6)
        said = show._look._facts.content
        assert "the store is damaged" in said
        assert "live: tshirt" in said
        put(show._clip._clip, "tube/a")
        show.step()
        assert len(show._all()) == 2
        assert "damaged" not in show._look._facts.content


def test_a_source_that_is_removed_while_it_is_shown_is_named_and_ends_nothing(data: Path) -> None:
    with page_server("127.0.0.1", 0) as server:
        show = Show(server, open_sources([data]))
        show.draw()
        assert show._clip is not None
        shutil.rmtree(data)
        show._go_to(3)
        show.step()  # some frames are in memory
        put(show._clip._clip, "tube/b")
        show.step()
        said = show._look._facts.content
        assert "data.zarr" in said
        assert "Error" not in said
        with pytest.raises(InputError):
            show.draw()
