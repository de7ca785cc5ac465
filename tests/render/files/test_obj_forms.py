"""OBJ and MTL in every form that the format allows, with the values by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from render import InputError, load_mesh
from render.files.mtl import textures

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLACES = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def read(tmp_path: Path, content: bytes, name: str = "a.obj"):
    (tmp_path / name).write_bytes(content)
    return load_mesh(tmp_path / name)


@pytest.mark.parametrize("mark", [b"\xef\xbb\xbf", b""])
@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r", b"\f\n", b" \t\n", b"\n\n"])
@pytest.mark.parametrize("name", ["a.obj", "A.OBJ", "a.Obj"])
def test_marks_and_line_ends_change_nothing(tmp_path, mark, end, name):
    mesh = read(tmp_path, mark + (TRIANGLE + b"v 9 9 9\nf 1 2 3\n").replace(b"\n", end), name)
    assert mesh.vertices.tolist() == [*PLACES, [9, 9, 9]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_utf_16_is_told_by_its_mark(tmp_path, encoding):
    assert (
        read(tmp_path, ("\ufeff" + (TRIANGLE + b"f 1 2 3\n").decode()).encode(encoding)).vertices.tolist()
        == PLACES
    )


def test_a_library_named_in_the_first_line_behind_a_mark(tmp_path):
    (tmp_path / "s.mtl").write_bytes(b"\xef\xbb\xbfnewmtl red\r\nKd 1 0 0\r\n")
    surface = read(tmp_path, b"\xef\xbb\xbfmtllib s.mtl\n" + TRIANGLE + b"usemtl red\nf 1 2 3\n").surface
    assert surface.mtl.split() == ["newmtl", "red", "Kd", "1", "0", "0"]


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_continued_lines_are_one(tmp_path, end):
    text = b"v 0 0 \\\n0\nv 1 0 0\nv 0 \\\n  1 \\\n 0\nf 1 2\\\n 3\n# a comment ends so: C:\\\nv 5 5 5\n"
    mesh = read(tmp_path, text.replace(b"\n", end))
    assert mesh.vertices.tolist() == [*PLACES, [5, 5, 5]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_a_wrong_line_behind_continued_ones_has_its_number_in_the_file(tmp_path):
    with pytest.raises(InputError, match="line 5 is not a valid vertex or face: 'v 1 x 0'"):
        read(tmp_path, b"v 0 \\\r\n0 \\\r\n0\r\n\r\nv 1 x 0\r\n")


def test_names_that_are_not_utf_8_stay_apart(tmp_path):
    one, two = "布料".encode("gbk"), "面料".encode("gbk")
    (tmp_path / "s.mtl").write_bytes(b"newmtl " + one + b"\nKd 1 0 0\nnewmtl " + two + b"\nKd 0 0 1\n")
    text = b"mtllib s.mtl\n" + TRIANGLE + b"usemtl " + one + b"\nf 1 2 3\nusemtl " + two + b"\nf 1 3 2\n"
    surface = read(tmp_path, text).surface
    assert len(set(surface.materials)) == 2
    assert surface.face_materials.tolist() == [0, 1]
    assert all(f"newmtl {name}\n" in surface.mtl for name in surface.materials)


def test_a_backslash_that_is_half_a_character_continues_no_line(tmp_path):
    name = "ソ".encode("shift-jis")  # 83 5C
    surface = read(tmp_path, TRIANGLE + b"usemtl " + name + b"\nf 1 2 3\nf 1 3 2\n").surface
    assert len(surface.faces) == 2
    assert surface.face_materials.tolist() == [0, 0]


def test_names_may_hold_what_unicode_takes_for_blanks_and_line_ends(tmp_path):
    names = ["a\u2028b", "a\u3000b", "a\xa0b", "a\x85b", "a  b", "a b"]
    text = "".join(f"usemtl {name}\nf 1 2 3\n" for name in names)
    assert read(tmp_path, TRIANGLE + text.encode()).surface.materials == tuple(names)


def test_signs_in_names_and_comments_behind_them(tmp_path):
    (tmp_path / "s.mtl").write_text("newmtl red\nKd 1 0 0\n")
    text = b"mtllib s.mtl\n" + TRIANGLE + b"usemtl Material #25\nf 1 2 3\nusemtl Material #26\nf 1 2 3\n"
    surface = read(tmp_path, text + b"usemtl red # of wool\nf 1 2 3 # last\n").surface
    assert surface.materials == ("Material #25", "Material #26", "red")


def test_loose_points_lines_groups_and_objects_are_passed_over(tmp_path):
    text = (
        b"o one\ng a b\ns off\nmg 0\n"
        + TRIANGLE
        + b"p 1\np 1 2\nl 1 2 3\nl 1/1 2/2\nlod 1\nvp 0.5\ng\no two\nf 1 2 3\n"
    )
    assert read(tmp_path, text).faces.tolist() == [[0, 1, 2]]


def test_vertices_with_weights_colours_exponents_tabs_and_leading_blanks(tmp_path):
    text = b"  v\t0 0 0 1\nv 1.0e0 0. -.0 0.5 0.25 1\nv +0 10E-1 0 1 1 0 0\nv 2 2 2\nf 1 2 3 4\n"
    mesh = read(tmp_path, text)
    assert mesh.vertices.tolist() == [*PLACES, [2, 2, 2]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_every_form_of_corner_in_one_file(tmp_path):
    text = b"vt .5\nvt 1 0\nvt 1 1 0\nvn 0 0 1\n"
    faces = b"f 1 2 3\nf 1/1 2/2 3/3\nf 1//1 2//1 3//1\nf 1/1/1 2/2/1 3/3/1\n"
    faces += b"f -3/-3/-1 -2/-2/-1 -1/-1/-1\nf 1/ 2/ 3/\nfo 1 2 3\n"
    surface = read(tmp_path, TRIANGLE + text + faces).surface
    assert surface.faces.tolist() == [[0, 1, 2]] * 7
    none, all_three = [-1] * 3, [0, 1, 2]
    assert surface.uv_faces.tolist() == [none, all_three, none, all_three, all_three, none, none]
    assert surface.uvs.tolist() == [[0.5, 0], [1, 0], [1, 1]]


def test_faces_may_stand_before_their_vertices_and_count_back_within_parts(tmp_path):
    text = b"f 4 5 6\n" + TRIANGLE + b"f -3 -2 -1\n" + TRIANGLE.replace(b"0\n", b"7\n") + b"f -3 -2 -1\n"
    assert read(tmp_path, text).faces.tolist() == [[3, 4, 5], [0, 1, 2], [3, 4, 5]]


def test_polygons_become_fans_in_their_order(tmp_path):
    text = b"".join(b"v %d %d 0\n" % (n, n * n) for n in range(6))
    mesh = read(tmp_path, text + b"f 1 2 3\nf 1 2 3 4 5 6\nf 2 3 4 5\n")
    fans = [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]]
    assert mesh.faces.tolist() == fans


@pytest.mark.parametrize(
    "named",
    [b"my look.mtl", b"a.mtl my look.mtl", b"MY LOOK.MTL", b".\\my look.mtl", b"a.mtl\nmtllib my look.mtl"],
)
def test_libraries_with_blanks_several_in_a_line_and_other_letters(tmp_path, named):
    (tmp_path / "my look.mtl").write_text("newmtl red\n")
    (tmp_path / "a.mtl").write_text("newmtl blue\n")
    surface = read(tmp_path, b"mtllib " + named + b"\n" + TRIANGLE + b"usemtl red\nf 1 2 3\n").surface
    assert "newmtl red\n" in surface.mtl
    assert ("newmtl blue\n" in surface.mtl) == (b"a.mtl" in named)


def test_images_behind_options_in_folders_of_windows_and_under_other_keywords(tmp_path):
    (tmp_path / "maps").mkdir()
    image = tmp_path / "maps" / "my  weave.png"
    image.write_bytes(b"png")
    lines = (
        b"newmtl a",
        b"map_kd -o 0 0 0 -s 2 2 maps\\my  weave.png",
        b"refl -type sphere maps/my  weave.png",
        b"",
    )
    (tmp_path / "s.mtl").write_bytes(b"\r\n".join(lines))
    mtl = read(tmp_path, b"mtllib s.mtl\n" + TRIANGLE + b"usemtl a\nf 1 2 3\n").surface.mtl
    assert textures(mtl) == [str(image.resolve())]
    assert f"refl -type sphere {image.resolve()}" in mtl


@pytest.mark.parametrize("line", [b"call other.obj", b"surf 0 1 0 1 1 2 3", b"bsp 1 2 3"])
def test_geometry_that_is_not_read_is_refused(tmp_path, line):
    with pytest.raises(InputError, match=f"line 5 '{line.decode()}' is no polygon of this file"):
        read(tmp_path, TRIANGLE + b"f 1 2 3\n" + line + b"\n")


@pytest.mark.parametrize("word", [b"1-2", b"1.5", b"1/2/x 0x1", b"/1", b"1e0", b"one"])
def test_corners_that_are_none(tmp_path, word):
    with pytest.raises(InputError, match="line 5 is not a valid vertex or face"):
        read(tmp_path, TRIANGLE + b"f 1 2 3\nf 1 2 " + word + b"\n")


def test_many_lines_are_read_as_few(tmp_path):
    """More lines than are taken at once, of several forms, against a plain loop."""
    rng = np.random.default_rng(0)
    places = rng.normal(size=(900, 3)).round(4)
    polygons = [rng.integers(1, 901, rng.integers(3, 6)).tolist() for _ in range(400)]
    text = "".join(
        f"v {x} {y} {z}\n" + ("vn 0 0 1\n" if n % 7 == 0 else "") for n, (x, y, z) in enumerate(places)
    )
    text += "".join("f " + " ".join(map(str, polygon)) + "\n" for polygon in polygons)
    from render.files import obj  # noqa: PLC0415

    whole = read(tmp_path, text.encode())
    (patched := pytest.MonkeyPatch()).setattr(obj, "_LINES_AT_ONCE", 13)
    parts = read(tmp_path, text.encode())
    patched.undo()
    wanted = [[p[0] - 1, p[k] - 1, p[k + 1] - 1] for p in polygons for k in range(1, len(p) - 1)]
    for mesh in (whole, parts):
        np.testing.assert_array_equal(mesh.vertices, places)
        assert mesh.faces.tolist() == wanted


@pytest.mark.parametrize("library", ["looks/s.mtl", ".\\looks\\s.mtl"])
def test_a_library_in_another_folder_names_its_images_from_there(tmp_path, library):
    (tmp_path / "looks").mkdir()
    for image in ("looks/weave.png", "wool.png"):
        (tmp_path / image).write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "looks/s.mtl").write_text("newmtl red\nmap_Kd weave.png\nnewmtl blue\nmap_Kd wool.png\n")
    text = b"mtllib " + library.encode() + b"\n" + TRIANGLE + b"usemtl red\nf 1 2 3\n"
    mtl = read(tmp_path, text).surface.mtl
    assert textures(mtl) == [str(tmp_path / "looks/weave.png"), str(tmp_path / "wool.png")]


@pytest.mark.parametrize("folder", ["C:\\Users\\me\\", "/home/me/", "\\\\server\\share\\"])
def test_full_paths_of_another_machine_mean_what_lies_beside(tmp_path, folder):
    (tmp_path / "weave.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "s.mtl").write_text(
        f"newmtl red\nKd 1 0 0\nmap_Kd -s 2 2 1 {folder}weave.png\nbump {folder}none.png\n"
    )
    text = f"mtllib {folder}s.mtl\n".encode() + TRIANGLE + b"usemtl red\nf 1 2 3\n"
    assert read(tmp_path, text).surface.mtl == (
        f"newmtl red\nKd 1 0 0\nmap_Kd -s 2 2 1 {tmp_path / 'weave.png'}\nbump none.png\n"
    )
