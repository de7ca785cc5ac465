"""Fixtures of the tests of `imgtransfer`."""

from __future__ import annotations

import pytest
import synthetic

from imgtransfer.data.clip import Clip


@pytest.fixture(scope="session")
def tube_clip() -> Clip:
    """Six frames of a rippling tube of cloth on a bending tube; see `synthetic.tube_clip`."""
    return synthetic.tube_clip()
