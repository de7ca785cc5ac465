"""What every HTML page must be: offline, for light and dark, for a phone, for who cannot see pictures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser

from imgtransfer.report.page_pictures import PICTURE_BYTES
from tests.helpers.browser import chromium, visited

PHONE, DESK = 360, 1280  # pixels wide
# What the browser made of the page. Contrast is that of WCAG 2.2: (lighter + 0.05) / (darker + 0.05), in luminance.
_LOOK = """() => {
  const channels = colour => colour.match(/[\\d.]+/g).map(Number);
  const luminance = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map(c => (c /= 255) <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * x + 0.7152 * y + 0.0722 * z;
  };
  const ground = element => {
    for (; element; element = element.parentElement) {
      const colour = channels(getComputedStyle(element).backgroundColor);
      if (colour.length === 3 || colour[3] > 0) return colour;
    }
    return [255, 255, 255];
  };
  const contrast = element => {
    const style = getComputedStyle(element);
    const pair = [channels(element instanceof SVGElement ? style.fill : style.color), ground(element)];
    const [dark, light] = pair.map(luminance).sort((a, b) => a - b);
    return (light + 0.05) / (dark + 0.05);
  };
  const quiet = ["SCRIPT", "BUTTON"];
  const told = [...document.body.querySelectorAll("*")].filter(element => !quiet.includes(element.tagName)
    && [...element.childNodes].some(node => node.nodeType === 3 && node.textContent.trim()));
  const lines = [...document.querySelectorAll("polyline")].map(line => {
    const pair = [channels(getComputedStyle(line).stroke), ground(line)].map(luminance).sort((a, b) => a - b);
    return (pair[1] + 0.05) / (pair[0] + 0.05);
  });
  const images = [...document.images];
  return {
    title: document.title,
    language: document.documentElement.lang,
    width: document.documentElement.scrollWidth,
    faint: told.filter(element => contrast(element) < 4.5).map(element => element.outerHTML.slice(0, 120)),
    faint_lines: lines.filter(ratio => ratio < 3).length,
    broken: images.filter(image => !image.complete || !image.naturalWidth).length,
    silent: images.filter(image => !image.alt.trim()).length
      + [...document.querySelectorAll("svg, .frame")].filter(one => !one.getAttribute("aria-label")).length,
    ground: ground(document.querySelector("section") || document.body),
  };
}"""


def check_page(path: Path) -> None:
    """Open a page in a real Chromium, light and dark, on a phone and on a desk, and look at what it became."""
    text = path.read_text(encoding="utf-8")
    pictures = re.findall(r"data:image/[^\"')]*", text)
    assert sum(map(len, pictures)) <= PICTURE_BYTES
    with chromium() as browser:
        looks = {
            (dark, width): _look(browser, path, dark, width)
            for dark in (False, True)
            for width in (PHONE, DESK)
        }
    for (dark, width), look in looks.items():
        assert look["title"].strip()
        assert look["language"] == "en"
        assert look["width"] <= width, f"{width} pixels wide, the page is {look['width']}"
        assert (look["faint"], look["faint_lines"]) == ([], 0), f"dark: {dark}"
        assert (look["broken"], look["silent"]) == (0, 0)
        assert (sum(look["ground"][:3]) < 3 * 64) == dark


def _look(browser: Browser, path: Path, dark: bool, width: int) -> dict[str, Any]:
    with visited(browser, path.resolve().as_uri(), width=width, dark=dark) as visit:
        if (button := visit.page.query_selector("button")) is not None:
            button.click()  # what plays, plays
            visit.page.wait_for_timeout(300)
        look: dict[str, Any] = visit.page.evaluate(_LOOK)
        visit.check()
    return look
