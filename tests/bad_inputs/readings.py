"""Which command reads which file, over all commands and kinds of files."""

from __future__ import annotations

from tests.bad_inputs.case import Reading

_OUT = "--out out"
_SMPL = "--smpl smpl --to out"
_CLIP = "clip.npz"
# Not simulated: all files are read before the clips are chosen, so that this is how good ones end, too.
_NONE = "--clip none/none --out"
_BEYOND = "--frames 9999: --out out/a.npz"  # likewise: the motion is read before its frames are chosen

CLIPS = (
    Reading("export-npz", "export clip.npz --out out/a.npz", _CLIP),
    Reading("predict", f"predict model.safetensors clip.npz {_OUT}", _CLIP),
    Reading(
        "train",
        f"train run.yaml --data clip.npz --set data.train.split=null --set data.validation.split=null {_OUT}",
        _CLIP,
        ("set",),
    ),
    Reading("evaluate", "evaluate p --truth clip.npz", _CLIP, writes=()),
    Reading("baseline", "evaluate --baseline lbs --truth clip.npz", _CLIP, writes=()),
    Reading("render", f"render clip.npz --size 24 {_OUT}", _CLIP),
    Reading("inspect", "inspect clip.npz", _CLIP, writes=()),
    Reading("inspect-page", "inspect clip.npz --html out/page.html", _CLIP),
    Reading("export-glb", "export clip.npz --out out/a.glb", _CLIP),
    Reading("export-usd", "export clip.npz --out out/a.usd", _CLIP),
    Reading("export-frames", "export clip.npz --out out/a --frames-as ply", _CLIP),
    Reading("import", "import clip.npz --split train --to out", _CLIP),
    Reading("fuse-body", f"fuse --maps maps.npz --body clip.npz --config fusion.yaml {_OUT}", _CLIP),
)
MAPS = (
    Reading("fuse", f"fuse --maps maps.npz --config fusion.yaml {_OUT}", "maps.npz"),
    Reading("fuse-predictions", "fuse p --config fusion.yaml", "p/clip/maps.npz", writes=("p/clip",)),
    Reading("inspect", "inspect maps.npz", "maps.npz", writes=()),
    Reading("fuse-adam", f"fuse --maps maps.npz --solver adam --config fusion.yaml {_OUT}", "maps.npz"),
)
EXR = Reading("fuse", f"fuse --maps exr --config fusion.yaml {_OUT}", "exr/00000.0.exr", named=("exr:",))
OTHER_NPZ = (
    Reading(
        "fuse-body",
        f"fuse --maps maps.npz --body body.npz --config fusion.yaml {_OUT}",
        "body.npz",
        named=("body_faces",),
    ),
    Reading(
        "fuse-initial", f"fuse --maps maps.npz --initial start.npz --config fusion.yaml {_OUT}", "start.npz"
    ),
    Reading("fuse-inner", f"fuse --maps maps.npz --inner start.npz --config fusion.yaml {_OUT}", "start.npz"),
    Reading(
        "fuse-pins",
        f"fuse --maps maps.npz --pins pins.npz --config fusion.yaml {_OUT}",
        "pins.npz",
        named=("--pins", "fuse: pins"),
    ),
    Reading(
        "fuse-predictions", "fuse p --config fusion.yaml", "p/clip/position_only.npz", writes=("p/clip",)
    ),
    Reading(
        "evaluate",
        "evaluate done --truth clip.npz",
        "done/clip/fused.npz",
        writes=(),
        named=("error: clip:",),
        optional=True,
    ),
    Reading(
        "evaluate",
        "evaluate p --truth clip.npz",
        "p/clip/position_only.npz",
        writes=(),
        named=("error: clip:",),
        optional=True,
    ),
    Reading(
        "simulate",
        f"simulate simulation.yaml motion.npz {_NONE} out",
        "motion.npz",
        named=("none/none",),
    ),
    Reading("dress", f"dress motion.npz --garment tshirt {_BEYOND}", "motion.npz", named=("--frames",)),
)
_SET = "set/tube/train/"
_OF_SET = ("tube/train", "clip npz")


def _of_set(file: str, *, root: bool = False) -> tuple[Reading, ...]:
    named = (file, "tube/train", *(("set:", "set/") if root else ()))
    return (
        Reading("predict", f"predict model.safetensors set {_OUT}", file, named=named),
        Reading("train", f"train run.yaml {_OUT}", file, named=named),
        Reading("evaluate", "evaluate --baseline lbs --truth set", file, writes=(), named=named),
        Reading("render", f"render set --size 24 --frames 0 {_OUT}", file, named=named),
        Reading("inspect", "inspect set", file, writes=(), named=named),
        Reading(
            "inspect-page", "inspect set --html out/page.html", file, named=(*named, "page.html says why")
        ),
        Reading("export", "export set --clip tube/train --out out/a", file, named=named),
        Reading("import", "import set --split train --to out", file, named=named),
        Reading(
            "import-into",
            "import clip.npz --split train --to set",
            file,
            writes=("set",),
            named=named,
            optional=not root,
        ),
    )


SET_ROOT = _of_set("set/zarr.json", root=True)
SET_CLIP = _of_set(f"{_SET}zarr.json")
SET_ARRAY = _of_set(f"{_SET}body_vertices/zarr.json")
SET_CHUNK = _of_set(f"{_SET}garment_vertices/c/0/0/0")
SET_REJECTED = (
    Reading("inspect", "inspect set", "set/rejected/tube__worse.json", writes=(), optional=True),
    Reading("simulate", f"simulate simulation.yaml {_NONE} set", "set/rejected/tube__worse.json",
            writes=("set",), named=("none/none",), optional=True),
)  # fmt: skip
SET_ZIP = (
    Reading("export", "export set.zip --clip tube/train --out out/a.npz", "set.zip"),
    Reading("export-zip", "export set.zip --out out/a.zip", "set.zip"),
    Reading("import", "import set.zip --to out", "set.zip", named=("tube/train", "tube/validation")),
    Reading("train", f"train run.yaml --data set.zip {_OUT}", "set.zip"),
    Reading("evaluate", "evaluate --baseline lbs --truth set.zip", "set.zip", writes=()),
)
MIGRATE = (
    Reading("migrate", "migrate old", "old/zarr.json", writes=("old",), named=("old/", "old:")),
    Reading("migrate", "migrate old", "old/tube/train/zarr.json", writes=("old",), named=("tube/train",)),
    Reading(
        "migrate", "migrate old", "old/tube/train/poses/zarr.json", writes=("old",), named=("tube/train",)
    ),
    Reading("migrate", "migrate old", "old/tube/train/trans/c/0/0", writes=("old",), named=("tube/train",)),
)
MODELS = (
    Reading("predict", f"predict model.safetensors clip.npz {_OUT}", "model.safetensors"),
    Reading("inspect", "inspect model.safetensors", "model.safetensors", writes=()),
)
_RESUME = "train run.yaml --resume --out run"
RESUME = {
    file: Reading(
        "resume", _RESUME, f"run/{file}", ("set",), ("run",), ("error: run:",), optional=file == "log.jsonl"
    )
    for file in ("state.safetensors", "config.yaml", "log.jsonl")
}
YAMLS = (
    Reading("train", f"train run.yaml {_OUT}", "run.yaml", needs=("set",), named=("set",)),
    Reading("simulate", f"simulate simulation.yaml {_NONE} out", "simulation.yaml", named=("none/none",)),
    Reading("fuse", f"fuse --maps maps.npz --config fusion.yaml {_OUT}", "fusion.yaml"),
    Reading("config", "config simulate simulation.yaml", "simulation.yaml", writes=()),
)
MOTION = Reading(
    "simulate",
    f"simulate motion.bvh {_NONE} out",
    "motion.bvh",
    named=("none/none", "nothing to simulate"),
)
DRESSED_BVH = Reading(
    "dress-bvh", f"dress motion.bvh --garment tshirt {_BEYOND}", "motion.bvh", named=("--frames",)
)
_IMPORT = "--split train --anyway --to out"
MESHES = (
    Reading("fuse-template", f"fuse --maps maps.npz --template template.obj --config fusion.yaml {_OUT}",
            "template.obj", ("cloth.mtl", "weave.png")),
    Reading("import-meshes", f"import meshes walk {_IMPORT}", "walk/garment/garment_0001.obj"),
    Reading("import-meshes", f"import meshes walk {_IMPORT}", "walk/template.obj"),
    Reading("import-meshes", f"import meshes walk {_IMPORT}", "walk/body_rest.obj"),
    Reading("render-meshes", f"render frames --template template.obj --size 24 {_OUT}",
            "frames/garment_0002.obj", ("cloth.mtl", "weave.png")),
)  # fmt: skip
BINARY_MESHES = tuple(
    Reading("fuse-template", f"fuse --maps maps.npz --template {file} --config fusion.yaml {_OUT}", file)
    for file in ("template.ply", "template.glb", "template.stl")
)
TEXT_PLY, GLTF = (
    Reading("fuse-template", f"fuse --maps maps.npz --template {file} --config fusion.yaml {_OUT}", file)
    for file in ("text.ply", "template.gltf")
)
CACHES = (
    Reading("import-pc2", f"import meshes pc2 {_IMPORT}", "pc2/garment.pc2"),
    Reading("import-mdd", f"import meshes mdd {_IMPORT}", "mdd/body.mdd"),
)
SCENES = (
    Reading("import-abc", f"import meshes scenes {_IMPORT}", "scenes/garment.abc"),
    Reading("import-usdc", f"import meshes scenes {_IMPORT}", "scenes/body.usdc"),
    Reading("import-usdz", f"import meshes packed {_IMPORT}", "packed/body.usdz"),
    Reading("render-abc", f"render scenes/garment.abc --template template.obj --size 24 {_OUT}",
            "scenes/garment.abc", ("template.obj", "cloth.mtl", "weave.png")),
    Reading("fuse-usdc", f"fuse --maps maps.npz --body scenes/body.usdc --config fusion.yaml {_OUT}",
            "scenes/body.usdc"),
    Reading("simulate-usdc", f"simulate scenes --template template.obj --anyway --dry-run {_OUT}",
            "scenes/body.usdc", ("template.obj", "cloth.mtl", "weave.png")),
)  # fmt: skip
TEXT_SCENES = (Reading("import-usda", f"import meshes text {_IMPORT}", "text/garment.usda"),)
FRAMES = (
    Reading("simulate-frames", f"simulate walk --template template.obj --anyway --dry-run {_OUT}",
            "walk/body/body_0001.obj", ("template.obj", "cloth.mtl", "weave.png")),
    Reading("fuse-frames", f"fuse --maps maps.npz --body walk/body --config fusion.yaml {_OUT}",
            "walk/body/body_0001.obj"),
)  # fmt: skip
MATERIALS = tuple(
    Reading("import-meshes", f"import meshes walk {_IMPORT}", f"walk/{file}", optional=True)
    for file in ("cloth.mtl", "weave.png")
)
PINS = Reading(
    "fuse-pins",
    f"fuse --maps maps.npz --pins pins.txt --config fusion.yaml {_OUT}",
    "pins.txt",
    named=("--pins", "fuse: pins"),
)
REPORTS = tuple(
    Reading(
        "fuse-predictions",
        "fuse done --config fusion.yaml",
        f"done/clip/{file}",
        writes=("done/clip",),
        optional=True,
    )
    for file in ("fusion.json", "fused.npz")
)
_VTO = f"import vto vto --template vto_rest {_SMPL}"
PICKLED = (
    Reading("import-vto", _VTO, "vto/tshirt/simulations/tshirt_shape00_01_01.pkl"),
    Reading(
        "import-vto-model",
        _VTO.replace("--smpl smpl", "--smpl pickled"),
        "pickled/SMPL_FEMALE.pkl",
        ("smpl",),
        named=("SMPL",),
    ),
    Reading("import-tailornet", "import tailornet tailornet --to out", "tailornet/garment_class_info.pkl"),
)
PUBLIC_NPZ = (
    Reading("import-vto-model", _VTO, "smpl/SMPL_FEMALE.npz", named=("SMPL",)),
    Reading(
        "import-tailornet",
        "import tailornet tailornet --to out",
        "tailornet/pant_female/pose/000_001/poses_004.npz",
        optional=True,
    ),
    Reading(
        "import-virtualbones",
        f"import virtualbones virtualbones/dress02 {_SMPL}",
        "virtualbones/dress02/7.npz",
    ),
)
PUBLIC_NPY = (
    Reading(
        "import-tailornet",
        "import tailornet tailornet --to out",
        "tailornet/pant_female/pose/000_001/unposed_004.npy",
        named=("poses_004",),
    ),
    Reading(
        "import-tailornet", "import tailornet tailornet --to out", "tailornet/pant_female/shape/beta_000.npy"
    ),
)
PUBLIC_OTHER = (
    Reading("import-cloth3d", f"import cloth3d cloth3d {_SMPL}", "cloth3d/01_01_s0/Tshirt.pc16"),
    Reading("import-cloth3d", f"import cloth3d cloth3d {_SMPL}", "cloth3d/01_01_s0/Tshirt.obj"),
    Reading("import-vto", _VTO, "vto_rest/tshirt.obj"),
    Reading(
        "import-virtualbones",
        f"import virtualbones virtualbones/dress02 {_SMPL}",
        "virtualbones/dress02/template.obj",
    ),
)
PUBLIC_MAT = Reading(
    "import-cloth3d", f"import cloth3d cloth3d {_SMPL}", "cloth3d/01_01_s0/info.mat", named=("--smpl",)
)
