"""What `parse_bvh` lets through and what it refuses, at the limits of each."""

import pytest

from imgtransfer.motions.bvh_hierarchy import DEEPEST, LARGEST
from imgtransfer.motions.bvh_text import parse_bvh
from render import InputError

CHANNELS = "CHANNELS 3 Xrotation Yrotation Zrotation"
FRAMES = ("1 2 3", "4 5 6")


def text(*, channels=CHANNELS, offset="0 1 0", depth=1, frames=FRAMES, announced=None, end="\n"):
    deeper = "".join(f"JOINT a{number}\n{{\n" for number in range(1, depth))
    hierarchy = f"HIERARCHY\nROOT a\n{{\n OFFSET {offset}\n {channels}\n{deeper}{'}' * depth}\n"
    count = len(frames) if announced is None else announced
    lines = hierarchy + "\n".join(["MOTION", f"Frames: {count}", "Frame Time: 0.1", *frames, ""])
    return lines.replace("\n", end)


def check(tmp_path, content):
    path = tmp_path / "a.bvh"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    parse_bvh(path)


@pytest.mark.parametrize("content", [
    text(),
    text(end="\r\n"),
    "\n\n" + text() + "\n\n",
    text(announced=1),  # what follows the announced frames is no harm
    text(depth=DEEPEST),
    text(offset=f"{LARGEST:g} {-LARGEST:g} 1e-300"),
    text(frames=(), announced=0),
    text(frames=("1\t2  3 ", "-1e3 .5 0")),
    text(frames=("1 2 3", "", "4 5 6"), announced=2),
    text(channels="CHANNELS 0", frames=()),
], ids=["plain", "crlf", "blank", "more", "deep", "large", "none", "spaces", "gap", "no channels"])  # fmt: skip
def test_whole_files_pass(tmp_path, content):
    check(tmp_path, content)


@pytest.mark.parametrize(("content", "wanted"), [
    ("", "not a whole BVH file"),
    (text().replace("MOTION", "MOTIONS"), "has HIERARCHY, MOTION, Frames: and Frame Time: in this order"),
    (text().replace("HIERARCHY", "HIERACHY"), "not a whole BVH file"),
    (text().replace("Frames: 2", "Frames: -2"), "not a whole BVH file"),
    (text().replace("Frames: 2", "Frames: two"), "not a whole BVH file"),
    (text()[: text().index("Frame Time")], "not a whole BVH file"),
    (text(depth=DEEPEST + 1), f"nested {DEEPEST + 1} deep, at most {DEEPEST} can be read"),
    (text().replace("}", ""), "braces do not match"),
    (text().replace("{", "} {"), "braces do not match"),
    (text(offset="0 nan 0"), "OFFSET holds nan; finite numbers up to 1e[+]09 are wanted"),
    (text(offset="0 1.1e9 0"), "OFFSET holds 1.1e[+]09"),
    (text(offset="0 x 0"), "OFFSET: could not convert"),
    (text(frames=("1 2 3", "4 5")), "frame 1 has 2 values for 3 channels"),
    (text(frames=("1 2 3 4", "4 5 6")), "frame 0 has 4 values for 3 channels"),
    (text(frames=("1 2 3", "4 -inf 6")), "frame 1 holds -inf"),
    (text(announced=3), "cut off, it announces 3 frames and holds 2"),
    (text(announced="9" * 400), "cut off, it announces 999999999999 frames"),
    (text(channels="CHANNELS 3 Xrotation Yrotation Wrotation"), "a channel is called 'Wrotation'; known are Xposition"),
    (text(channels="CHANNELS 2 Xrotation Yrotation"), "frame 0 has 3 values for 2 channels"),
    (b"\xff\xfeH\x00I\x00", "not a BVH file, which would be text"),
])  # fmt: skip
def test_damaged_files_are_refused_in_one_line_with_their_name(tmp_path, content, wanted):
    with pytest.raises(InputError, match=wanted) as caught:
        check(tmp_path, content)
    assert str(caught.value).startswith(f"{tmp_path / 'a.bvh'}: ")
    assert "\n" not in str(caught.value)


def test_folders_and_missing_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="BVH file"):
        parse_bvh(tmp_path)
    with pytest.raises(InputError, match="no such file"):
        parse_bvh(tmp_path / "none.bvh")
