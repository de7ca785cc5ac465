"""What the site makes of the pages' links: those inside of docs stay, others, which it does not hold, are named."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from mkdocs.structure.files import File

from scripts.docs.site import on_page_markdown


def shown(where: str, text: str) -> str:
    """`text` on the page `where` of docs, as the site has it."""
    file = File(where, src_dir="docs", dest_dir="site", use_directory_urls=False)
    return on_page_markdown(text, page=SimpleNamespace(file=file))


@pytest.mark.parametrize(
    ("where", "link"),
    [
        ("data.md", "[the map files](maps.md#cameras)"),
        ("tutorials/vto.md", "[Train](../training.md#pretrained-encoders)"),
        ("tutorials/vto.md", "![a shirt](../images/overview.png)"),
        ("tutorials/deeper/vto.md", "[Cluster](../cluster.md) and [Train](../../training.md)"),
    ],
)
def test_a_link_inside_of_docs_stays(where: str, link: str) -> None:
    assert shown(where, link) == link


@pytest.mark.parametrize(
    ("where", "link", "named"),
    [
        ("data.md", "[the recipe](../configs/data/sample.yaml)", "the recipe (`configs/data/sample.yaml`)"),
        ("data.md", "[`configs/pretrained`](../configs/pretrained/)", "`configs/pretrained`"),
        ("tutorials/vto.md", "[the file](../../configs/paper.yaml)", "the file (`configs/paper.yaml`)"),
        ("tutorials/vto.md", "[`README.md`](../../README.md), [Maps](../maps.md)", "`README.md`, [Maps](../maps.md)"),
    ],
)  # fmt: skip
def test_a_link_out_of_docs_becomes_a_path(where: str, link: str, named: str) -> None:
    assert shown(where, link) == named
