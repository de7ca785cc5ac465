"""Text of other tools (OBJ, MTL) as lines, whatever ends or continues them, marks the start, or encodes the names."""

from __future__ import annotations

import codecs
import re

_WIDE_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_TO_LINE_FEEDS = bytes.maketrans(b"\r\f\v", b"\n\n\n")
# A backslash is the second byte of some characters of Shift-JIS, Big5 and GBK: behind a byte above 127 it ends a name.
_CONTINUED = re.compile(rb"#[^\n]*|(?<![\x80-\xff])\\ ?\n")


def plain_lines(content: bytes, *, joined: bool = True) -> bytes:
    """The text with a line feed behind every statement, and no mark at its start.

    Marks of UTF-8 and UTF-16 go; carriage returns and form feeds end lines, too; continued lines (a backslash at the
    end, not in comments) become one, unless `joined` is False. Either way the text is as long, place by place.
    """
    if content.startswith(_WIDE_MARKS):
        content = content.decode("utf-16", errors="replace").encode()
    content = content.removeprefix(codecs.BOM_UTF8).rstrip(
        b"\x1a\0"
    )  # end marks of DOS, and of fixed-size buffers
    if b"\r\n" in content:
        content = content.replace(b"\r\n", b" \n")
    content = content.translate(_TO_LINE_FEEDS)
    if joined and b"\\" in content:
        content = _CONTINUED.sub(_blank_unless_comment, content)
    return content


def _blank_unless_comment(part: re.Match[bytes]) -> bytes:
    return part[0] if part[0].startswith(b"#") else b" " * len(part[0])


def as_text(content: bytes) -> str:
    r"""UTF-8, or where it is none with every other byte written out as \xb2: different bytes stay different names."""
    return content.decode("utf-8", errors="backslashreplace")
