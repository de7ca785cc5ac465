"""Fixtures of the tests of `imgtransfer`."""

from __future__ import annotations

import pytest

from imgtransfer.data.clip import Clip
from tests.helpers import synthetic


@pytest.fixture(scope="session")
def tube_clip() -> Clip:
    """Six frames of a rippling tube of cloth on a bending tube; see `synthetic.tube_clip`."""
    return synthetic.tube_clip()
