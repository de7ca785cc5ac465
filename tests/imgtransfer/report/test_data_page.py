"""The page about a data set: what it shows, and that a clip's texts stay texts."""

from __future__ import annotations

import re
from pathlib import Path

from imgtransfer.report import write_data_page
from imgtransfer.report.data_page import ClipPart

CELLS = ("test", "2", "30", "9", "-", "-", "-", "")


def test_hostile_texts_are_shown_and_do_nothing(tmp_path: Path) -> None:
    hostile = """"><script>alert('x')</script>"""
    part = ClipPart(f"a/{hostile}", (*CELLS[:-1], hostile), (hostile, "{{ 7 * 7 }}"), facts=hostile)
    page = write_data_page(tmp_path / "page.html", hostile, {hostile: hostile}, [part]).read_text()
    assert "<script" not in page
    # Title and heading, the fact, the list (link, name, finding), the row (link, name, cell), the section (id, heading,
    # finding, facts).
    assert page.count("&lt;script&gt;") == 2 + 2 + 3 + 3 + 4
    assert set(re.findall(r"<(\w+)", page)) <= {
        "html", "head", "meta", "title", "style", "body", "main", "h1", "h2", "section", "p", "b", "ul", "li", "a",
        "div", "table", "thead", "tbody", "tr", "th", "td",
    }  # fmt: skip
    assert "{{ 7 * 7 }}" in page
    for attribute in re.findall(r'(?:id|href)="([^"]*)"', page):
        assert "<" not in attribute


def test_clips_with_findings_are_listed_first_and_link_to_their_sections(tmp_path: Path) -> None:
    parts = [
        ClipPart("a/good", CELLS, (), facts="two frames", plots=("<svg></svg>",)),
        ClipPart("a/bad", CELLS, ("jumps", "slides")),
    ]
    page = write_data_page(tmp_path / "page.html", "Set", {"licence": "CC0-1.0"}, parts).read_text()
    assert "To look at: 1 of 2 clips" in page
    assert '<li><a href="#a__bad">a/bad</a>: jumps; slides</li>' in page
    assert page.count('id="a__bad"') == 1
    assert page.count("<svg>") == 1
    assert (
        "Nothing looks wrong in 1 clips"
        in write_data_page(tmp_path / "b.html", "Set", {}, parts[:1]).read_text()
    )
