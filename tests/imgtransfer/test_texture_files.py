"""Textures come along with the meshes that use them."""

from imgtransfer.data.mesh_output import save_mesh_frames
from imgtransfer.data.texture_files import bring_textures
from render import load_mesh

OBJ = "mtllib shirt.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl cloth\nf 1/1 2/2 3/3\n"


def test_textures_are_copied_under_free_names_and_those_missing_are_named(tmp_path):
    for folder in ("a", "b c"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "weave.png").write_text(folder)
    (tmp_path / "secret.key").write_text("secret")
    out = tmp_path / "out"
    out.mkdir()
    mtl = (
        f"newmtl one\nmap_Kd {tmp_path}/a/weave.png\nbump -bm 0.5 {tmp_path}/b c/weave.png\n"
        f"newmtl two\nmap_Kd {tmp_path}/a/weave.png\nmap_d {tmp_path}/gone.png\n"
        f"map_Ks {tmp_path}/secret.key\nKd 1 1 1\nmap_Ka plain.png\n"
    )
    text, missing = bring_textures(mtl, out)
    assert text == (
        "newmtl one\nmap_Kd weave.png\nbump -bm 0.5 weave-2.png\n"
        "newmtl two\nmap_Kd weave.png\nmap_d gone.png\nmap_Ks secret.key\nKd 1 1 1\nmap_Ka plain.png\n"
    )
    assert missing == [f"{tmp_path}/gone.png", f"{tmp_path}/secret.key", "plain.png"]
    assert {file.name: file.read_text() for file in out.iterdir()} == {"weave.png": "a", "weave-2.png": "b c"}


def test_written_frames_can_be_moved_with_their_textures(tmp_path, capsys):
    (tmp_path / "in").mkdir()
    (tmp_path / "in/shirt.obj").write_text(OBJ)
    (tmp_path / "in/shirt.mtl").write_text("newmtl cloth\nmap_Kd weave.png\nmap_d holes.png\n")
    (tmp_path / "in/weave.png").write_text("weave")
    mesh = load_mesh(tmp_path / "in/shirt.obj")
    for kind in ("obj", "ply"):
        save_mesh_frames(tmp_path / kind, mesh.vertices[None], mesh, kind)
        assert (tmp_path / kind / "weave.png").read_text() == "weave"
        said = capsys.readouterr().err
        assert "holes.png; put them beside the written files" in said
        assert said.count("\n") == 1
    assert (tmp_path / "obj/materials.mtl").read_text() == "newmtl cloth\nmap_Kd weave.png\nmap_d holes.png\n"
    assert b"comment TextureFile weave.png" in (tmp_path / "ply/frame_0000.ply").read_bytes()
    (tmp_path / "obj").rename(tmp_path / "moved")
    assert f"map_Kd {tmp_path}/moved/weave.png" in load_mesh(tmp_path / "moved/frame_0000.obj").surface.mtl
