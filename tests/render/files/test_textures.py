"""Paths in material libraries, which come from anywhere: only images under the mesh's folder are followed."""

from pathlib import Path

import pytest

from render.files.textures import change_paths, image_under, is_image, with_full_paths


@pytest.fixture
def folder(tmp_path):
    """A mesh's folder with an image, and one beside it."""
    inside = tmp_path / "mesh"
    (inside / "tex").mkdir(parents=True)
    (inside / "tex" / "red cloth.png").touch()
    (tmp_path / "secret.png").touch()
    (inside / "passwords.txt").touch()
    return inside


def test_the_longest_path_that_somebody_knows_is_changed():
    """Options stand before a path, which may have spaces: `-s 2 2 my cloth.png`."""
    asked = []

    def change(path):
        asked.append(path)
        return "NEW" if path == "my cloth.png" else None

    text = "newmtl a\nKd 1 1 1\nmap_Kd -s 2 2 my cloth.png\nbump\n"
    assert change_paths(text, change) == "newmtl a\nKd 1 1 1\nmap_Kd -s 2 2 NEW\nbump\n"
    assert asked == ["-s 2 2 my cloth.png", "2 2 my cloth.png", "2 my cloth.png", "my cloth.png"]


@pytest.mark.parametrize("keyword", ["map_Kd", "map_Bump", "bump", "disp", "norm"])
def test_every_keyword_that_names_an_image(keyword):
    assert change_paths(f"  {keyword}   a.png", str.upper) == f"{keyword} A.PNG\n"
    assert change_paths(f"x{keyword} a.png", str.upper) == f"x{keyword} a.png\n"


def test_images_under_the_folder_get_full_paths_and_others_lose_theirs(folder):
    found = with_full_paths(
        f"map_Kd tex/red cloth.png\nmap_Ks ../secret.png\nmap_Ka {folder.parent}/secret.png\nmap_d /etc/passwd\n",
        folder,
    )
    assert found.splitlines() == [
        f"map_Kd {folder / 'tex' / 'red cloth.png'}",
        "map_Ks ../secret.png",  # not followed, and of no use to who reads it
        "map_Ka secret.png",
        "map_d passwd",
    ]
    assert with_full_paths(f"map_Kd {folder}/tex/red cloth.png", None) == "map_Kd red cloth.png\n"


@pytest.mark.parametrize(
    "path",
    [
        "../secret.png",
        "passwords.txt",
        "tex",
        "tex/blue.png",
        "",
        "a\0b.png",
        "x" * 5000 + ".png",
        "/dev/null",
    ],
)
def test_what_is_no_image_under_the_folder(folder, path):
    assert image_under(folder, path) is None


def test_links_are_followed_before_it_is_said_where_they_are(folder):
    (folder / "out.png").symlink_to(folder.parent / "secret.png")
    (folder / "text.png").symlink_to("passwords.txt")
    (folder / "in.png").symlink_to("tex/red cloth.png")
    (folder / "circle.png").symlink_to("circle.png")
    assert image_under(folder, "out.png") is None
    assert image_under(folder, "text.png") is None
    assert image_under(folder, "circle.png") is None
    assert image_under(folder, "in.png") == folder / "tex" / "red cloth.png"
    assert image_under(folder, "tex/../tex/red cloth.png") == folder / "tex" / "red cloth.png"


PLAIN_TGA = bytes([0, 0, 2, *[0] * 13, 24, 0])


@pytest.mark.parametrize(
    ("name", "content", "want"),
    [
        ("a.png", b"\x89PNG\r\n\x1a\n...", True),
        ("a.png", b"\xff\xd8\xff\xe0", True),  # a JPEG of another name
        ("a.webp", b"RIFF\x10\0\0\0WEBPVP8 ", True),
        ("a.webp", b"RIFF\x10\0\0\0WAVEfmt ", False),  # a sound
        ("a.exr", b"v/1\x01\x02", True),
        ("a.png", b"root:x:0:0", False),
        ("a.png", b"", False),
        ("a.tga", PLAIN_TGA, True),
        ("a.png", PLAIN_TGA, False),
        ("a.tga", PLAIN_TGA[:17], False),
        ("a.tga", PLAIN_TGA.replace(b"\x18", b"\x17"), False),  # 23 bits a pixel
        ("a.tga", b"text that is long enough", False),
    ],
)
def test_images_are_known_by_how_they_begin(tmp_path, name, content, want):
    (tmp_path / name).write_bytes(content)
    assert is_image(tmp_path / name) == want


def test_folders_missing_and_huge_files_are_no_images(tmp_path):
    (tmp_path / "folder.png").mkdir()
    with (tmp_path / "huge.png").open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        file.truncate(2**28 + 1)
    for name in ("folder.png", "missing.png", "huge.png"):
        assert not is_image(Path(tmp_path / name))
