"""The site, built and opened from the disk in a real Chromium, in light and dark, as wide as a phone.

The quick tests build it without the references of public names, which take most of the time; the long one builds all.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from mkdocs.commands.build import build
from mkdocs.config import load_config
from playwright.sync_api import Browser

from tests.helpers.browser import chromium, visited
from tests.helpers.pages import PHONE
from tests.helpers.paths import ROOT

QUICK = ("index.html", "first_look.html", "fusion.html", "reference/commands.html")
_LOOK = """async () => {
  const images = [...document.images];
  for (const image of images) image.loading = "eager";
  await Promise.all(images.map(image => image.decode().catch(() => null)));
  return {
    title: document.title,
    scheme: document.body.dataset.mdColorScheme,
    width: Math.max(document.documentElement.scrollWidth, document.body.scrollWidth),
    broken: images.filter(image => !image.naturalWidth).map(image => image.src),
    silent: images.filter(image => !image.alt.trim()).map(image => image.src),
    dead: [...document.links].filter(link => link.hash && link.pathname === location.pathname)
      .map(link => decodeURIComponent(link.hash.slice(1))).filter(name => name && !document.getElementById(name)),
  };
}"""


def build_site(folder: Path, **changed: object) -> Path:
    """Build the site into a folder; `changed` are keys of mkdocs.yml that differ."""
    build(load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder), **changed))
    return folder


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every page, but without what mkdocstrings makes of the packages' docstrings."""
    return build_site(tmp_path_factory.mktemp("site"), plugins=["search", "offline"], strict=True)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


def check(browser: Browser, path: Path) -> None:
    for dark in (False, True):
        with visited(browser, path.as_uri(), width=PHONE, dark=dark) as visit:
            look = visit.page.evaluate(_LOOK)
            visit.check()
        assert look.pop("width") <= PHONE, path.name
        assert "imgtransfer" in look.pop("title")
        scheme = "slate" if dark else "default"
        assert look == {"scheme": scheme, "broken": [], "silent": [], "dead": []}, path.name


@pytest.mark.parametrize("page", QUICK)
def test_a_page_opens_from_the_disk(page: str, site: Path, browser: Browser) -> None:
    check(browser, site / page)


def test_the_search_works_from_the_disk(site: Path, browser: Browser) -> None:
    """No server, no other host: a word is typed, and the page that is about it is among the first results."""
    with visited(browser, (site / "index.html").as_uri()) as visit:
        visit.page.click("[data-md-component=search-query]")
        visit.page.keyboard.type("untangling")
        visit.page.wait_for_selector(".md-search-result__item a", timeout=120_000)
        addresses = [
            link.get_attribute("href") or ""
            for link in visit.page.query_selector_all(".md-search-result__item a")
        ]
        assert any("fusion.html" in address or "architecture.html" in address for address in addresses[:5])
        visit.page.click(f'.md-search-result__item a[href="{addresses[0]}"]')
        visit.page.wait_for_selector("article")
        assert not visit.page.url.endswith("index.html")
        visit.check()


@pytest.mark.long
def test_every_page_opens_from_the_disk(tmp_path: Path, browser: Browser) -> None:
    """All but the one that servers show for what they do not have, which asks for its style at the server's root."""
    built = build_site(tmp_path / "site", strict=True)
    pages = sorted(page for page in built.rglob("*.html") if page.name != "404.html")
    assert len(pages) > 20
    for page in pages:
        check(browser, page)
