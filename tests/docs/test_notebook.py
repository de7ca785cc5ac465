"""The notebook runs from its first cell to its last, and what it ends with is right."""

from __future__ import annotations

import base64
import json
import re
import sys
from pathlib import Path

import cv2
import nbformat
import numpy as np
import pytest
from jupyter_client import KernelManager
from nbclient import NotebookClient

from tests.helpers.paths import ROOT

NOTEBOOK = ROOT / "docs" / "first_look.ipynb"
LIMIT_S = 600  # a cell, on a busy machine


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> nbformat.NotebookNode:
    return executed(tmp_path_factory.mktemp("jupyter"))


def executed(folder: Path) -> nbformat.NotebookNode:
    """The notebook after a run by this interpreter, whatever kernels are registered on this machine.

    The kernel's files are in `folder`; it raises where a cell does.
    """
    spec = folder / "kernels" / "tested"
    spec.mkdir(parents=True)
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    content = {"argv": argv, "display_name": "tested", "language": "python", "env": {"PYTHONPATH": str(ROOT)}}
    (spec / "kernel.json").write_text(json.dumps(content))
    manager = KernelManager(kernel_name="tested")
    manager.kernel_spec_manager.kernel_dirs = [str(folder / "kernels")]
    manager.connection_file = str(folder / "connection.json")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    resources = {"metadata": {"path": str(NOTEBOOK.parent)}}
    NotebookClient(notebook, km=manager, timeout=LIMIT_S, resources=resources).execute()
    return notebook


def test_it_is_committed_without_outputs_and_is_valid() -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


def test_every_vertex_that_is_seen_is_read_back(ran: nbformat.NotebookNode) -> None:
    seen, misread_mm = re.search(r"(\d+)% of the vertices are seen, .* to ([\d.]+) mm", printed(ran)).groups()
    assert int(seen) > 80
    assert float(misread_mm) < 1.0


def test_what_is_fused_is_nearer_to_the_truth_than_skinning(ran: nbformat.NotebookNode) -> None:
    row = {
        name: [
            float(value)
            for value in re.search(rf"^{name} +([\d. ]+)$", printed(ran), re.MULTILINE)[1].split()
        ]
        for name in ("skinned", "positions only", "fused")
    }
    rmse_mm, inside_percent = {name: values[0] for name, values in row.items()}, row["fused"][6]
    assert max(rmse_mm["positions only"], rmse_mm["fused"]) < rmse_mm["skinned"] / 2
    assert inside_percent == 0


def test_the_last_picture_shows_four_bodies_and_three_errors(ran: nbformat.NotebookNode) -> None:
    *_, last = pictures(ran)
    height, width, _ = last.shape
    assert height > 420 * 2  # two rows, the lower one with a bar
    assert width > 300 * 4
    columns = np.array_split(last[: height // 2], 4, axis=1)
    assert all((column < 250).any(axis=-1).mean() > 0.05 for column in columns)  # something is drawn in each


def test_pictures_have_alternative_texts(ran: nbformat.NotebookNode) -> None:
    shown = [
        out for cell in ran.cells for out in cell.get("outputs", ()) if "image/png" in out.get("data", {})
    ]
    assert len(shown) == len(pictures(ran)) >= 4
    assert all(out.metadata["image/png"]["alt"] for out in shown)


def printed(notebook: nbformat.NotebookNode) -> str:
    streams = [
        out for cell in notebook.cells for out in cell.get("outputs", ()) if out.output_type == "stream"
    ]
    return "".join(out.text for out in streams if out.name == "stdout")


def pictures(notebook: nbformat.NotebookNode) -> list[np.ndarray]:
    """(H, W, 3) uint8 each."""
    data = [out.get("data", {}) for cell in notebook.cells for out in cell.get("outputs", ())]
    encoded = [content["image/png"] for content in data if "image/png" in content]
    return [
        cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR) for text in encoded
    ]
