import dataclasses

import numpy as np
import pytest
import torch
from example_meshes import tube

from render import InputError, MapFile, PositionBox, TemplateImager, load_maps, save_maps


@pytest.fixture(scope="module")
def maps():
    imager = TemplateImager.build(tube(20, 12), size=(24, 32))
    vertices = torch.tensor(imager.mesh.vertices, dtype=torch.float32).expand(2, -1, -1)
    box = PositionBox.around(imager.mesh.vertices)
    return MapFile.of(
        imager,
        position=imager.position_maps(vertices, box).numpy(),
        normal=imager.normal_maps(vertices).numpy(),
        box=box,
        rotation=np.stack([np.eye(3)] * 2),
        translation=np.array([[0.0, 1, 0], [0, 2, 0]]),
        fps=30,
    )


def test_round_trip_is_exact(maps, tmp_path):
    save_maps(tmp_path / "walk.npz", maps)
    read = load_maps(tmp_path / "walk.npz")
    for field in dataclasses.fields(MapFile):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(maps, field.name))
    assert read.position.dtype == np.float32
    assert [path.name for path in tmp_path.iterdir()] == ["walk.npz"]


def test_the_imager_can_be_made_again(maps, tmp_path):
    save_maps(tmp_path / "walk.npz", maps)
    read = load_maps(tmp_path / "walk.npz")
    imager = TemplateImager.build(read.template, cameras=read.cameras)
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
        ("normal", np.zeros((2, 2, 24, 31, 3))),
        ("position", np.full((2, 2, 24, 32, 3), np.nan)),
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
    with pytest.raises(InputError, match=r"flipped\.npz: not a readable npz"):
        load_maps(path)


def test_a_pickle_is_not_opened(tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, position=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match=r"evil\.npz: not a readable npz"):
        load_maps(path)


def test_another_format_version_or_a_missing_array(maps, tmp_path):
    path = tmp_path / "maps.npz"
    save_maps(path, maps)
    arrays = dict(np.load(path))
    np.savez(path, **(arrays | {"format_version": 2}))
    with pytest.raises(InputError, match="version 1 expected, found 'imgtransfer-maps' version 2"):
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
