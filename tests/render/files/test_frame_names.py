"""Which number in the names of files is the frame's: with signs, padding, brackets and other numbers beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from render import InputError
from render.files.frame_files import frame_files

ORDERED = {
    "negative": ["f_-10", "f_-9", "f_-8", "f_-7"],
    "from negative to positive": ["f_-2", "f_-1", "f_0", "f_1"],
    "a sign without a separator": ["f-1", "f0", "f1"],
    "a sign, padded": ["f.-0002", "f.-0001", "f.0000", "f.0001"],
    "numbers alone": ["-1", "0", "1"],
    "hyphens are no signs": ["f-1", "f-2", "f-3"],
    "hyphens after numbers are none": ["2-1", "2-2", "2-3"],
    "padded and not": ["f8", "f09", "f10", "f0011"],
    "padded to different widths": ["f_99", "f_100", "f_0101"],
    "brackets": ["f [9]", "f [10]", "f [11]"],
    "parentheses": ["f (1)", "f (2)", "f (3)"],
    "brackets of no number": ["[x] f9", "[x] f10"],
    "another number before": ["shirt2_frame_001", "shirt2_frame_002", "shirt2_frame_003"],
    "another number behind": ["shirt_9_v2", "shirt_10_v2", "shirt_11_v2"],
    "numbers on both sides": ["4k_9_lod0", "4k_10_lod0"],
    "a hash": ["f#9", "f#10"],
    "digits of another script": ["f\u0669", "f\u0661\u0660"],
}


def write(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for name in names:
        (folder / name).write_text("")
    return folder


@pytest.mark.parametrize("kind", ORDERED)
def test_frames_are_in_the_order_of_their_numbers(tmp_path: Path, kind: str) -> None:
    folder = write(tmp_path / "x", [f"{name}.obj" for name in reversed(ORDERED[kind])])
    assert [file.stem for file in frame_files(folder)] == ORDERED[kind]


@pytest.mark.parametrize("rest", ["rest.obj", "body_rest.obj", "template.ply", "Rest_Pose.OBJ"])
def test_a_rest_pose_among_the_frames_is_none_of_them(tmp_path: Path, rest: str) -> None:
    folder = write(tmp_path / "x", ["f_1.obj", "f_2.obj", rest])
    assert [file.name for file in frame_files(folder)] == ["f_1.obj", "f_2.obj"]
    assert [file.name for file in frame_files(write(tmp_path / "alone", [rest]))] == [rest]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["f_-3", "f_-2", "f_0"], r"missing between f_-3\.obj and f_0\.obj: -1 \(3 files"),
        (["f-2", "f0", "f1"], r"missing between f-2\.obj and f1\.obj: -1 "),
        (["shirt_1_v2", "shirt_2_v2", "shirt_4_v2"], "v2.obj: 3 "),
        (["f_1", "f_001"], "are the same frame"),
        (["f_-1", "f_-01"], "are the same frame"),
        (["f_1", "f_2", "odd"], r"several kinds \(f_#\.obj, odd\.obj\).*x/f_\*\.obj'"),
        (["f_1", "f_2", "f_1 copy"], r"several kinds \(f_# copy\.obj, f_#\.obj\).*x/f_\*\[0-9\]\.obj'"),
        (["a1_1", "a1_2", "a2_1", "a2_2"], r"several kinds \(a1_#\.obj, a2_#\.obj\).*x/a1_\*\.obj'"),
        (["one", "two"], "several kinds"),
    ],
)
def test_what_is_no_sequence_is_named(tmp_path: Path, names: list[str], message: str) -> None:
    folder = write(tmp_path / "x", [f"{name}.obj" for name in names])
    with pytest.raises(InputError, match=message):
        frame_files(folder)


@pytest.mark.parametrize("kind", ["f [v]", "f#", "f?", "f*"])
def test_the_pattern_that_is_proposed_means_one_of_the_kinds(tmp_path: Path, kind: str) -> None:
    folder = write(tmp_path / "x", [f"{kind}_{number}.obj" for number in (1, 2)] + ["g_1.obj", "g_2.obj"])
    with pytest.raises(InputError) as error:
        frame_files(folder)
    proposed = str(error.value).split("'")[1]
    assert [file.name for file in frame_files(Path(proposed))] in (
        [f"{kind}_1.obj", f"{kind}_2.obj"],
        ["g_1.obj", "g_2.obj"],
    )
