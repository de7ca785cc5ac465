"""The tutorials, run from their first block to their last, as a reader would; the short ones in the ordinary run."""

from __future__ import annotations

import os
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml

from imgtransfer.benchmark.config import BenchmarkConfig
from imgtransfer.simulation.config import SimulateConfig
from imgtransfer.simulation.planning.plan import plan
from tests.helpers.page_files import write_vto
from tests.helpers.paths import ROOT
from tests.helpers.tutorials import blocks, run_page

TUTORIALS = ROOT / "docs" / "tutorials"
SHORT = ("maps_only", "fusion_only")
LONG = ("own_meshes", "vto", "cluster", "new_method")


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with what the pages take from a clone."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_tutorial_is_run() -> None:
    assert {path.stem for path in TUTORIALS.glob("*.md")} == {*SHORT, *LONG}


@pytest.mark.parametrize("name", SHORT)
def test_a_short_tutorial(name: str, clone: Path) -> None:
    run_page(TUTORIALS / f"{name}.md", clone)


def test_the_configurations_of_the_long_ones_are_read() -> None:
    files = {
        block.file: yaml.safe_load(block.text)
        for name in LONG
        for block in blocks(TUTORIALS / f"{name}.md")
        if block.language == "yaml"
    }
    tasks = plan(SimulateConfig.model_validate(files["recipe.yaml"]))
    assert len(tasks) == 4  # as the page on clusters says
    assert {task.name for task in tasks if fnmatch(task.name, "*walk*") or fnmatch(task.name, "*kick*")} == {
        "skirt/walk_s104",
        "skirt/kick_s107",
    }
    for name in ("methods.yaml", "skirt.yaml"):
        assert len(BenchmarkConfig.model_validate(files[name]).methods) > 1


def test_a_page_stops_at_the_first_line_that_fails(clone: Path) -> None:
    page = clone / "page.md"
    page.write_text("```bash\ntouch first\nimgtransfer inspect nothing.zarr\ntouch last\n```\n")
    with pytest.raises(AssertionError, match=r"(?s)page.md:2: exit status 2 of.*nothing.zarr: no such file"):
        run_page(page, clone)
    assert (clone / "first").exists()
    assert not (clone / "last").exists()


def test_what_a_page_says_is_printed_must_be_printed(clone: Path) -> None:
    page = clone / "page.md"
    code = "```python\nprint('12 frames,  1.5 s')\nprint('done')\n```\n"
    page.write_text(code + "```text\n7 frames, 20.25 s\n```\n")
    run_page(page, clone)
    page.write_text(code + "```text\ndo...\n7 frames, 20.25 s\n```\n")
    with pytest.raises(AssertionError, match=r"(?s)page.md:6: .*7 frames, 20.25 s\nand printed was"):
        run_page(page, clone)


def test_comments_say_where_the_test_departs_from_a_page(clone: Path) -> None:
    page = clone / "page.md"
    page.write_text(
        "<!-- test: 1000 => 2 -->\n```bash\necho 1000 > steps\n```\n"
        "<!-- not run: nobody has one -->\n```bash\nexit 1\n```\n"
        "```yaml\n# new/run.yaml\nsteps: 3\n```\n"
    )
    run_page(page, clone)
    assert (clone / "steps").read_text() == "2\n"
    assert (clone / "new/run.yaml").read_text() == "# new/run.yaml\nsteps: 3\n"
    page.write_text("<!-- test: 100 => 2 -->\n```bash\necho 5\n```\n")
    with pytest.raises(AssertionError, match="no '100' to replace"):
        run_page(page, clone)


@pytest.mark.long
def test_own_meshes(clone: Path) -> None:
    run_page(TUTORIALS / "own_meshes.md", clone)


@pytest.mark.long
def test_vto(clone: Path) -> None:
    write_vto(clone)
    run_page(TUTORIALS / "vto.md", clone)


@pytest.mark.long
def test_cluster(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from ray.cluster_utils import Cluster  # noqa: PLC0415  (seconds, which the others need not wait for)

    memory = {"object_store_memory": 80 * 2**20}
    monkeypatch.setenv("PYTHONPATH", str(ROOT))  # for its workers
    machines = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, **memory})
    monkeypatch.setenv("RAY_ADDRESS", machines.address)
    try:
        machines.add_node(num_cpus=1, **memory)
        run_page(TUTORIALS / "cluster.md", clone)
    finally:
        machines.shutdown()


@pytest.mark.long
def test_new_method(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The package is installed in a folder of its own, where Python looks for packages, too."""
    (clone / "packages").mkdir()
    monkeypatch.syspath_prepend(str(clone / "packages"))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(clone / "packages"), str(ROOT)]))
    run_page(TUTORIALS / "new_method.md", clone)
