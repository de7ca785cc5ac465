import dataclasses
import os
import struct

import numpy as np
import OpenEXR
import pytest
import torch

from render import (
    InputError,
    MapFile,
    PositionBox,
    TemplateImager,
    load_maps,
    open_maps,
    save_maps,
    written_maps,
)
from tests.helpers.example_meshes import tube


@pytest.fixture(scope="module")
def maps():
    imager = TemplateImager.build(tube(20, 12), size=(24, 32), layers=2, backend="numpy")
    vertices = torch.tensor(imager.mesh.vertices, dtype=torch.float32).expand(2, -1, -1)
    box = PositionBox.around(imager.mesh.vertices)
    return MapFile.of(
        imager,
        position=imager.position_maps(vertices, box).numpy(),
        normal=imager.normal_maps(vertices).numpy(),
        box=box,
        rotation=np.stack([np.eye(3)] * 2),
        translation=np.array([[0.0, 1, 0], [0, 2, 0]]),
        fps=29.97,
        confidence=np.random.default_rng(0).random((2, *imager.mask.shape)),
    )


def assert_same(read, maps):
    for field in dataclasses.fields(MapFile):
        found, expected = getattr(read, field.name), getattr(maps, field.name)
        np.testing.assert_array_equal(found, expected)
        assert np.asarray(found).dtype == np.asarray(expected).dtype, field.name


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
def test_round_trip_is_exact(maps, tmp_path, name):
    save_maps(tmp_path / name, maps)
    read = load_maps(tmp_path / name)
    assert_same(read, maps)
    assert read.position.dtype == np.float32
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
def test_what_is_optional_may_be_missing(maps, tmp_path, name):
    bare = dataclasses.replace(maps, position=None, confidence=None, depth=None, layers=None)
    assert bare.layers.tolist() == [0, 0, 0, 0]
    save_maps(tmp_path / name, bare)
    assert_same(load_maps(tmp_path / name), bare)


def test_files_of_version_1_are_read(maps, tmp_path):
    path = tmp_path / "old.npz"
    save_maps(path, maps)
    arrays = {
        key: value for key, value in np.load(path).items() if key not in ("layers", "confidence", "depth")
    }
    np.savez(path, **(arrays | {"format_version": 1}))
    read = load_maps(path)
    assert read.confidence is None
    assert read.layers.tolist() == [0, 0, 0, 0]
    np.testing.assert_array_equal(read.position, maps.position)


def test_files_of_version_2_are_read(maps, tmp_path):
    path = tmp_path / "old.npz"
    save_maps(path, maps)
    np.savez(path, **(dict(np.load(path)) | {"format_version": 2}))
    read = load_maps(path)
    assert read.rest_vertices is None
    np.testing.assert_array_equal(read.rest.vertices, maps.template_vertices)


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
def test_a_rest_shape_is_kept(maps, tmp_path, name):
    wide = dataclasses.replace(maps, rest_vertices=maps.template_vertices * [1.1, 1, 1.2])
    save_maps(tmp_path / name, wide)
    assert_same(load_maps(tmp_path / name), wide)
    np.testing.assert_array_equal(load_maps(tmp_path / name).rest.faces, maps.template_faces)
    save_maps(tmp_path / name, maps)  # in place of the other
    assert load_maps(tmp_path / name).rest_vertices is None
    with pytest.raises(InputError, match="rest_vertices must be finite, of shape"):
        dataclasses.replace(maps, rest_vertices=maps.template_vertices[:-1])


def test_a_rest_shape_with_other_faces_is_refused(maps, tmp_path):
    save_maps(tmp_path / "walk", dataclasses.replace(maps, rest_vertices=maps.template_vertices))
    rest = tmp_path / "walk" / "rest.obj"
    rest.write_text("\n".join(rest.read_text().splitlines()[:-1]))
    with pytest.raises(InputError, match=r"rest\.obj: its faces are not those of template\.obj"):
        load_maps(tmp_path / "walk")


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
def test_the_contact_offset_is_kept_to_the_last_bit(maps, tmp_path, name):
    known = dataclasses.replace(maps, contact_offset_m=0.1 / 30)
    save_maps(tmp_path / name, known)
    assert load_maps(tmp_path / name).contact_offset_m == 0.1 / 30
    save_maps(tmp_path / name, maps)  # in place of the other
    assert load_maps(tmp_path / name).contact_offset_m is None


@pytest.mark.parametrize("metres", [-0.001, 0.05, np.nan, np.inf])
def test_cloth_that_cannot_rest_so_far_off_the_skin_is_refused(maps, metres):
    with pytest.raises(InputError, match=r"contact_offset_m is .*; metres .* from 0 to below 0\.05"):
        dataclasses.replace(maps, contact_offset_m=metres)


def test_a_contact_offset_that_is_no_number_is_refused(maps, tmp_path):
    save_maps(tmp_path / "walk.npz", maps)
    for value in (np.ones(3), np.array("thin")):
        np.savez(tmp_path / "odd.npz", **(dict(np.load(tmp_path / "walk.npz")) | {"contact_offset_m": value}))
        with pytest.raises(InputError, match=r"odd\.npz: contact_offset_m must be one number; found"):
            load_maps(tmp_path / "odd.npz")


def test_images_of_one_folder_with_other_contact_offsets_are_refused(maps, tmp_path):
    save_maps(tmp_path / "thin", dataclasses.replace(maps, contact_offset_m=0.004))
    for name, known in (("none", None), ("thick", 0.005)):
        save_maps(tmp_path / name, dataclasses.replace(maps, contact_offset_m=known))
        (tmp_path / "thin" / "00001.2.exr").write_bytes((tmp_path / name / "00001.2.exr").read_bytes())
        with pytest.raises(InputError, match=r"00001\.2\.exr: .*'contactOffset'"):
            load_maps(tmp_path / "thin")


def test_the_imager_can_be_made_again(maps, tmp_path):
    save_maps(tmp_path / "walk.npz", maps)
    read = load_maps(tmp_path / "walk.npz")
    imager = TemplateImager.build(read.template, cameras=read.cameras, backend="numpy")
    assert [camera.layer for camera in imager.cameras] == [0, 1, 0, 1]
    np.testing.assert_array_equal(read.depth, imager.raster.depth)
    np.testing.assert_array_equal(imager.mask.numpy(), read.mask)
    vertices = torch.tensor(read.template_vertices, dtype=torch.float32)
    np.testing.assert_allclose(imager.position_maps(vertices, read.box).numpy(), read.position[0], atol=1e-6)


def test_either_kind_of_map_may_be_missing(maps, tmp_path):
    save_maps(tmp_path / "n.npz", dataclasses.replace(maps, position=None))
    read = load_maps(tmp_path / "n.npz")
    assert read.position is None
    np.testing.assert_array_equal(read.normal, maps.normal)
    with pytest.raises(InputError, match="found neither"):
        dataclasses.replace(maps, position=None, normal=None)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("normal", np.zeros((2, 4, 24, 31, 3))),
        ("position", np.full((2, 4, 24, 32, 3), np.nan)),
        ("confidence", np.ones((2, 4, 24, 31))),
        ("confidence", np.full((2, 4, 24, 32), -0.1)),
        ("layers", np.zeros(3)),
        ("layers", np.array([-1, 0, 0, 0])),
        ("depth", np.zeros((2, 24, 32))),
        ("rotation", np.zeros((3, 3, 3))),
        ("mask", np.ones((1, 24, 32), bool)),
        ("template_faces", np.array([[0, 1, 9999]])),
        ("box_hi", np.full(3, -9.0)),
        ("fps", 0.0),
    ],
)
def test_arrays_that_do_not_fit_are_refused(maps, field, value):
    with pytest.raises(InputError):
        dataclasses.replace(maps, **{field: value})


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.npz: no such file"):
        load_maps(tmp_path / "none.npz")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_truncated_file(maps, tmp_path, share):
    path = tmp_path / "cut.npz"
    save_maps(path, maps)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"cut\.npz: not a readable npz"):
        load_maps(path)


def test_damaged_content(maps, tmp_path):
    path = tmp_path / "flipped.npz"
    save_maps(path, maps)
    content = bytearray(path.read_bytes())
    content[2000:2400] = bytes(400)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"flipped\.npz: .* is not a readable plain array"):
        load_maps(path)


def test_a_pickle_is_not_opened(tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, position=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"evil\.npz: position is not a readable plain array"):
        load_maps(path)


def test_another_format_version_or_a_missing_array(maps, tmp_path):
    path = tmp_path / "maps.npz"
    save_maps(path, maps)
    arrays = dict(np.load(path))
    np.savez(path, **(arrays | {"format_version": 5}))
    with pytest.raises(InputError, match="version 1, 2, 3 or 4 expected, found 'imgtransfer-maps' version 5"):
        load_maps(path)
    np.savez(path, a=np.zeros(3))
    with pytest.raises(InputError, match="found 'none'"):
        load_maps(path)
    del arrays["rotation"]
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="rotation missing"):
        load_maps(path)


def test_other_suffixes_are_refused(maps, tmp_path):
    with pytest.raises(InputError, match=r"end in \.npz"):
        save_maps(tmp_path / "maps.zip", maps)
    assert list(tmp_path.iterdir()) == []


# some frames at a time


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
@pytest.mark.parametrize("count", [1, 3, 5])
def test_parts_make_the_whole(maps, tmp_path, name, count):
    five = [maps.part(slice(frame, frame + 1)) for frame in (0, 1, 1, 0, 1)]
    with written_maps(tmp_path / name) as add:
        for part in five:
            add(part)
    reader = open_maps(tmp_path / name)
    assert reader.n_frames == 5
    whole = load_maps(tmp_path / name)
    np.testing.assert_array_equal(whole.position, np.concatenate([part.position for part in five]))
    for found in (list(reader.parts(count)), list(whole.parts(count))):
        assert [part.n_frames for part in found] == [
            *[count] * (5 // count),
            *([5 % count] if 5 % count else []),
        ]
        for field in ("position", "normal", "confidence", "rotation", "translation"):
            np.testing.assert_array_equal(
                np.concatenate([getattr(part, field) for part in found]), getattr(whole, field)
            )
        np.testing.assert_array_equal(found[-1].mask, maps.mask)


@pytest.mark.parametrize("name", ["walk.npz", "walk"], ids=["npz", "exr"])
def test_maps_whose_writing_stops_leave_nothing(maps, tmp_path, name):
    def stopped():
        with written_maps(tmp_path / name) as add:
            add(maps)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert list(tmp_path.iterdir()) == []


def test_arrays_of_other_numbers_of_frames_are_refused_before_they_are_read(maps, tmp_path):
    path = tmp_path / "maps.npz"
    save_maps(path, maps)
    np.savez(path, **(dict(np.load(path)) | {"translation": np.zeros((3, 3))}))
    with pytest.raises(InputError, match=r"translation must be of shape \(2, 3\); found \(3, 3\)"):
        open_maps(path)


# OpenEXR


@pytest.fixture
def folder(maps, tmp_path):
    save_maps(tmp_path / "walk", maps)
    return tmp_path / "walk"


def test_a_folder_has_a_file_a_frame_and_image_with_named_channels(folder, maps):
    assert sorted(path.name for path in folder.iterdir()) == [
        *(f"{frame:05d}.{image}.exr" for frame in range(2) for image in range(4)),
        "template.obj",
    ]
    with OpenEXR.File(str(folder / "00001.2.exr"), separate_channels=True) as file:
        header, channels = dict(file.header()), file.channels()
        kinds = [f"{kind}.{axis}" for kind in ("position", "normal") for axis in "XYZ"]
        assert sorted(channels) == sorted([*kinds, "mask", "depth", "confidence"])
        np.testing.assert_array_equal(channels["position.Y"].pixels, maps.position[1, 2, ..., 1])
        assert channels["position.Y"].pixels.dtype == np.float32
    assert (header["view"], header["layer"], header["frame"], header["image"]) == ("back", 0, 1, 2)
    np.testing.assert_array_equal(header["viewMatrix"], maps.view_matrices[2])
    np.testing.assert_array_equal(header["boxHi"], maps.box_hi)


def test_a_folder_of_maps_is_replaced_and_one_of_anything_else_is_not(folder, maps, tmp_path):
    save_maps(folder, dataclasses.replace(maps, fps=60))
    assert load_maps(folder).fps == 60
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        save_maps(folder, maps)
    assert (folder / "notes.txt").read_text() == "mine"


def drop_channel(path, name):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {key: channel.pixels.copy() for key, channel in file.channels().items() if key != name}
        header = {key: value for key, value in file.header().items() if key not in ("channels", name)}
    OpenEXR.File(header, channels).write(str(path))


def set_header(path, **changes):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {key: channel.pixels.copy() for key, channel in file.channels().items()}
        header = {key: value for key, value in file.header().items() if key != "channels"} | changes
    OpenEXR.File(header, channels).write(str(path))


def cut(path):
    path.write_bytes(path.read_bytes()[:-50])


def widen(path, length):
    """Let the header say that the image is `length` pixels high and wide."""
    content = path.read_bytes()
    start = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    window = struct.pack("<4i", 0, 0, length - 1, length - 1)
    path.write_bytes(content[:start] + window + content[start + 16 :])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda f: (f / "00001.3.exr").unlink(), "frame 1, image 3 is missing"),
        (lambda f: (f / "00000.0.exr").write_bytes(b"no image"), "not a readable OpenEXR file"),
        (
            lambda f: (f / "again.exr").write_bytes((f / "00000.0.exr").read_bytes()),
            "two files are of one image",
        ),
        (lambda f: (f / "template.obj").unlink(), "no such file"),
        (lambda f: drop_channel(f / "00000.1.exr", "mask"), "no channel 'mask'"),
        (lambda f: drop_channel(f / "00001.1.exr", "normal.X"), "its size or channels are not those of"),
        (lambda f: drop_channel(f / "00000.0.exr", "boxLo"), "its header lacks 'boxLo'"),
        (lambda f: drop_channel(f / "00000.0.exr", "frame"), "its header lacks 'frame'"),
        (lambda f: [path.unlink() for path in f.glob("*.exr")], "no .exr files in it"),
        (lambda f: cut(f / "00001.2.exr"), r"00001\.2\.exr: not a readable OpenEXR file"),
        (lambda f: widen(f / "00001.2.exr", 9000), r"00001\.2\.exr: 9000 x 9000 pixels of 9 channels"),
        (lambda f: widen(f / "00001.2.exr", -5), "not a readable OpenEXR file|-5 x -5 pixels"),
        (lambda f: set_header(f / "00001.1.exr", rotation="none"), "'rotation' .* must have shape"),
        (
            lambda f: set_header(f / "00001.1.exr", rotation=np.eye(3) * 2),
            "'rotation' .* is not that of 00001.0",
        ),
        (lambda f: set_header(f / "00000.0.exr", viewMatrix=np.eye(3)), "'viewMatrix' .* must have shape"),
        (lambda f: set_header(f / "00000.0.exr", boxLo="low"), "'boxLo' .* must have shape"),
        (lambda f: set_header(f / "00000.0.exr", frame=-1), "'frame' in its header must be a whole number"),
        (lambda f: set_header(f / "00000.0.exr", frame=999_999), "frame 0, image 0 is missing"),
        (lambda f: [set_header(file, fps="fast") for file in f.glob("*.exr")], "fps must be one number"),
        (lambda f: [set_header(file, fps="inf") for file in f.glob("*.exr")], "fps is inf"),
        (
            lambda f: [path.unlink() for path in [f / "00000.1.exr"]] and os.mkfifo(f / "00000.1.exr"),
            "a pipe",
        ),
    ],
)
def test_folders_that_cannot_be_used(folder, spoil, message):
    spoil(folder)
    with pytest.raises(InputError, match=message):
        load_maps(folder)


def test_damaged_images_print_nothing(folder, capfd):
    cut(folder / "00001.2.exr")
    with pytest.raises(InputError):
        load_maps(folder)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rotation": np.stack([np.eye(3), np.diag([1.0, 1, -1])])}, "that of frame 1 mirrors"),
        ({"rotation": np.stack([np.eye(3), np.eye(3) * 1.1])}, "that of frame 1 is none"),
        ({"rotation": np.zeros((2, 3, 3))}, "that of frame 0 is none"),
        (
            {"translation": np.array([[0, 0, 0], [0, 1e300, 0]])},
            r"translation: vertex 1 is .* beyond ±10000 m",
        ),
        ({"fps": np.inf}, "fps is inf"),
        ({"fps": np.nan}, "fps is nan"),
        ({"fps": 1e9}, "fps is 1000000000.0"),
        ({"box_hi": np.full(3, 1e300)}, "position box"),
        ({"box_hi": np.full(3, 1e5)}, "position box"),
        ({"view_matrices": np.tile(np.eye(4) * 1e300, (4, 1, 1))}, "view must be a finite"),
        ({"layers": np.full(4, 10**9)}, "layer must be a whole number from 0 to 63"),
    ],
)
def test_values_that_cannot_be_meant(maps, changes, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(maps, **changes)


@pytest.mark.parametrize(("name", "value"), [("position", 1e30), ("normal", -1e30), ("confidence", 1e30)])
def test_pixels_that_cannot_be_meant(maps, name, value):
    row, column = np.argwhere(maps.mask[0])[0]
    changed = getattr(maps, name).copy()
    changed[1, 0, row, column] = value
    with pytest.raises(InputError, match=f"{name} .*1e.30"):
        dataclasses.replace(maps, **{name: changed})


def test_what_lies_off_the_silhouette_may_be_anything_finite(maps):
    row, column = np.argwhere(~maps.mask[0])[0]
    changed = maps.position.copy()
    changed[1, 0, row, column] = 1e30
    assert dataclasses.replace(maps, position=changed).position[1, 0, row, column, 0] == np.float32(1e30)
