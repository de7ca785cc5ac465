"""No page has Python that nothing runs; that of docs/benchmark.md runs here."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from imgtransfer.deformers import FitFolder
from tests.helpers.paths import ROOT
from tests.helpers.synthetic import tube_clip

BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
RUN_BY = {  # the test that runs a page's Python
    "README.md": "tests/docs/test_readme.py",
    "docs/benchmark.md": "tests/docs/test_python.py",
    "docs/data.md": "tests/docs/test_data.py",
    "docs/fusion.md": "tests/docs/test_fusion.py",
    "docs/maps.md": "tests/docs/test_maps.py",
    "docs/training.md": "tests/imgtransfer/training/test_hub.py",
}


def test_every_page_with_python_has_a_test_that_runs_it() -> None:
    with_python = {str(page.relative_to(ROOT)) for page in PAGES if BLOCK.search(page.read_text())}
    of_tutorials = {name for name in with_python if name.startswith("docs/tutorials/")}  # run as they are
    assert with_python - of_tutorials == set(RUN_BY)
    for page, test in RUN_BY.items():
        name = Path(page).name
        assert name in (ROOT / test).read_text(), f"{test} does not name {page}"


def test_the_method_of_the_page_on_the_benchmark_is_one(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "benchmark.md").read_text()
    (program,) = BLOCK.findall(page)
    home, name = re.findall(r'^still = "(\w+\.\w+):(\w+)"$', page, re.MULTILINE)[0]
    assert program.startswith(f"# {home.replace('.', '/')}.py:")
    space: dict[str, Any] = {}
    exec(compile(program, "docs/benchmark.md", "exec"), space)
    kind = space[name]
    clip = tube_clip(4)
    method, restored = kind(kind.Config()), kind(kind.Config())
    method.fit([clip], FitFolder(tmp_path))
    restored.restore(method.tensors())
    np.testing.assert_array_equal(method.predict(clip), np.repeat(clip.garment.vertices[:1], 4, axis=0))
    np.testing.assert_array_equal(restored.predict(clip), method.predict(clip))
