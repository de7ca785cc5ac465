"""The notebook as a page of the site: its cells as they are, nothing is run. Hooks of MkDocs (mkdocs.yml)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

NOTEBOOK, PAGE = "first_look.ipynb", "first_look.md"


def on_files(files: Any, config: Any) -> Any:
    """Add the page; MkDocs copies the notebook itself."""
    from mkdocs.structure.files import File  # noqa: PLC0415

    files.append(File.generated(config, PAGE, content=page_of(Path(config.docs_dir) / NOTEBOOK)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to the notebook become links to its page, but for the one on that page."""
    return markdown if page.file.src_uri == PAGE else markdown.replace(f"({NOTEBOOK})", f"({PAGE})")


def page_of(path: Path) -> str:
    """The cells of a notebook as Markdown: below the first, which has the heading, a link to the file.

    Args:
        path: of the notebook, which begins with a cell of Markdown.
    """
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    parts.insert(
        1, f"These are its cells; with pictures and numbers they come by running [{path.name}]({path.name})."
    )
    return "\n\n".join([*parts, ""])
