"""The two solvers: the parts of local_global, and both of them on the same problems."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import torch
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from fusion import BodySdf, FusionConfig, Topology, fuse
from fusion.losses import edge_length_loss
from fusion.solvers.adam import AdamSolver
from fusion.solvers.contact import ConstrainedStep
from fusion.solvers.energy import Energy
from fusion.solvers.local_global import LocalGlobalSolver
from fusion.solvers.memory import PAIRS, StepMemory
from fusion.solvers.pixel_faces import PixelFaces
from fusion.solvers.recorder import frames_last
from fusion.solvers.system import System
from fusion.stages import StageProblem, edge_weights, normal_weights, total
from render import InputError, Mesh, TemplateImager
from render.mesh.normals import safe_normalize
from tests.helpers.fusion_examples import (
    cylinder_body,
    imager_of,
    inputs_of,
    leaning,
    true_maps,
    tube,
    wrinkled,
)

SOLVERS = ["local_global", "adam"]
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def scene():
    """Imager, maps as a network would make them (positions blurred), posed bodies, truth."""
    mesh, body = tube(), cylinder_body()
    imager = imager_of(mesh, (64, 64))
    truth = wrinkled(mesh, 3)
    positions, normals = true_maps(imager, truth)
    mask = imager.mask.numpy().astype(np.float32)
    coverage = gaussian_filter(mask, (0, 1.5, 1.5))[..., None]
    blurred = (
        gaussian_filter(positions.numpy(), (0, 0, 1.5, 1.5, 0)) / np.maximum(coverage, 1e-6) * mask[..., None]
    )
    return {
        "imager": imager,
        "truth": truth.numpy(),
        "inputs": {
            "positions": torch.from_numpy(blurred.astype(np.float32)),
            "normals": normals,
            "body": (leaning(np.asarray(body.vertices), 3), np.asarray(body.faces)),
        },
    }


def solved(scene, config=None, **changed):
    """`fuse` of the scene, some inputs changed."""
    options = {} if isinstance(config, FusionConfig) else config or {}
    config = config if isinstance(config, FusionConfig) else FusionConfig(**options)
    return fuse(scene["imager"], inputs_of(**(scene["inputs"] | changed)), config)


def error_mm(vertices, scene, chosen=slice(None)):
    return 1000 * np.linalg.norm(vertices - scene["truth"], axis=-1)[:, chosen].mean()


def random_matrix(n=40, seed=0):
    sparse = scipy.sparse.random(n, n, density=0.1, rng=np.random.default_rng(seed))
    return (sparse @ sparse.T + scipy.sparse.eye(n)).tocsr()


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
@pytest.mark.parametrize("frames", [1, 2, 50])
def test_a_system_is_solved_for_every_frame_and_axis(dtype, tolerance, frames):
    matrix = random_matrix()
    noise = torch.randn(frames, 40, 3, generator=torch.Generator().manual_seed(0), dtype=dtype)
    right, found = (frames_last(frames, 40, 3, like=noise) for _ in range(2))
    solve = System(matrix, CPU, dtype).solver(right, found, torch.ones(-(-frames // 8), dtype=torch.int32))
    for scale in (1.0, 3.0):  # what stands there when it is called
        right.copy_(scale * noise)
        solve()
        back = np.einsum("ij,tjc->tic", matrix.toarray(), found.numpy())
        np.testing.assert_allclose(back, right.numpy(), atol=scale * tolerance)


def test_a_system_that_is_not_definite_is_refused():
    with pytest.raises(ValueError, match="not positive definite"):
        System(scipy.sparse.diags([1.0, -1.0, 2.0]).tocsr(), CPU, torch.float64)


def test_remembered_steps_act_as_the_two_loop_recursion():
    """Against the textbook's loops, one problem at a time; a pair of negative curvature counts in neither."""
    frames, generator = 2, torch.Generator().manual_seed(0)
    topology = Topology(patch())
    shape = frames, topology.n_vertices, 3
    size = 3 * topology.n_vertices

    def noise(*shape):
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    root = noise(frames, size, size)
    hessian = root @ root.mT + torch.eye(size)
    zeros = torch.zeros(shape, dtype=torch.float64)
    energy = Energy(topology, {}, zeros, torch.ones(1, topology.n_vertices, dtype=torch.float64))
    begun = ConstrainedStep(energy, None, None)
    memory, kept = StepMemory(energy, begun), []
    for number in range(PAIRS + 3):
        step = noise(frames, size)
        change = (hessian @ step[..., None])[..., 0]
        if number == PAIRS + 1:
            change[0] *= -1
        begun.vertices.zero_()
        begun.gradient.zero_()
        energy.vertices.copy_(step.view(shape))
        energy.gradient.copy_(change.view(shape))
        memory.add()
        assert torch.equal(begun.vertices, energy.vertices)
        assert torch.equal(begun.gradient, energy.gradient)
        kept = [*kept, (step, change)][-PAIRS:]
        gradient = noise(frames, size)
        begun.gradient.copy_(gradient.view(shape))
        memory.prepare()
        memory.solution.copy_(0.3 * memory.right)
        memory.lead()
        found = begun.direction.reshape(frames, size)
        slope = (found * gradient).sum(1)
        torch.testing.assert_close(memory.slope(), slope)
        for frame in range(frames):
            pairs = [(s[frame], y[frame]) for s, y in kept if s[frame] @ y[frame] > 0]
            want = -two_loops(pairs, gradient[frame])
            torch.testing.assert_close(found[frame], want, rtol=1e-8, atol=1e-8)
        begun.length.zero_()  # so that any positive curvature counts


def two_loops(pairs, gradient):
    rest, alphas = gradient.clone(), []
    for step, change in reversed(pairs):
        alphas.append(step @ rest / (step @ change))
        rest = rest - alphas[-1] * change
    found = 0.3 * rest
    for step, change in pairs:
        found = found + (alphas.pop() - change @ found / (step @ change)) * step
    return found


def patch() -> Mesh:
    """A square of cloth of 9 x 9 vertices that faces the camera."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9)))
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = [[corner, corner + 1, corner + 10], [corner, corner + 10, corner + 9]]
    return Mesh(np.stack([x, y, 0 * x], axis=1), np.concatenate([np.stack(part, axis=1) for part in faces]))


def small_problem():
    """The patch in float64: folded, noisy vertices, and target normals that no vertices meet."""
    mesh = patch()
    imager = TemplateImager.build(mesh, views=("front",), size=(20, 20), backend="numpy")
    topology = Topology(mesh)
    pixel_faces = PixelFaces.of(imager.raster, topology)
    generator = torch.Generator().manual_seed(0)
    folded = torch.from_numpy(mesh.vertices).repeat(2, 1, 1)
    folded[..., 2] += 0.01 * torch.sin(40 * folded[..., 0])
    anchor = folded + 0.001 * torch.randn(folded.shape, generator=generator, dtype=torch.float64)
    target = pixel_faces.product(topology.n_vertices)(topology.normals(folded))
    target = target + 0.1 * torch.randn(target.shape, generator=generator, dtype=torch.float64)
    return topology, pixel_faces, StageProblem(start=anchor, anchor=anchor), safe_normalize(target)


def made(topology, pixel_faces, config):
    """Both solvers in float64."""
    seen = torch.ones(topology.n_vertices, dtype=torch.bool)
    return (
        LocalGlobalSolver(
            topology, config, seen=seen, pixel_faces=pixel_faces, device=CPU, dtype=torch.float64
        ),
        AdamSolver(topology, config, pixels=pixel_faces.product(topology.n_vertices)),
    )


def test_both_solvers_reach_the_same_optimum_of_the_first_stage():
    topology, pixel_faces, problem, _ = small_problem()
    config = FusionConfig(edge_steps=1500, learning_rate_m=6e-5, edge_iterations=500, edge_tolerance=0.0)
    found, want = (solver.edge_stage(problem) for solver in made(topology, pixel_faces, config))
    least, reference = (total(minimum.at(-1), edge_weights(config)) for minimum in (found, want))
    torch.testing.assert_close(least, reference, rtol=1e-5, atol=0)
    assert (found.vertices - want.vertices).norm(dim=-1).max() < 2e-5  # metres; edges are 35 mm long


def test_both_solvers_reach_the_same_optimum_of_the_second_stage():
    """Adam comes within 2 % of ours in as many steps as there is time for, and finds nothing lower from there."""
    topology, pixel_faces, problem, target = small_problem()
    config = FusionConfig(
        normal_steps=600, learning_rate_m=1e-4, normal_iterations=1000, normal_tolerance=0.0
    )
    problem = replace(problem, target=target)
    ours, adam = made(topology, pixel_faces, config)
    found, want = ours.normal_stage(problem), adam.normal_stage(problem)
    least, reference = (total(minimum.at(-1), normal_weights(config)) for minimum in (found, want))
    assert (least <= reference).all()
    assert (reference <= 1.02 * least).all()
    _, fine = made(topology, pixel_faces, config.model_copy(update={"learning_rate_m": 1e-7}))
    again = fine.normal_stage(replace(problem, start=found.vertices))
    assert (total(again.at(-1), normal_weights(config)) >= least * (1 - 1e-5)).all()
    assert (again.vertices - found.vertices).norm(dim=-1).max() < 2e-5  # metres


def test_every_step_lowers_the_objective():
    topology, pixel_faces, problem, target = small_problem()
    config = FusionConfig(normal_iterations=30, normal_tolerance=0.005)
    solver, _ = made(topology, pixel_faces, config)
    found = solver.normal_stage(StageProblem(start=problem.start, anchor=problem.anchor, target=target))
    curve = total(found.history, normal_weights(config))
    assert len(curve) > 10
    assert (curve.diff(dim=0) <= 0).all()


def test_local_global_ends_no_higher_than_adam_and_as_near_to_the_truth(scene):
    """On a coarse mesh with time to spare; on fine ones the defaults do (scripts/bench/fusion.py)."""
    patient = {"edge_tolerance": 0.02, "normal_iterations": 80, "normal_tolerance": 0.001}
    ours, adam = (solved(scene, {"solver": solver} | patient) for solver in SOLVERS)
    assert ours.report["total"]["normal"]["end"] <= adam.report["total"]["normal"]["end"]
    assert error_mm(ours.vertices, scene) <= error_mm(adam.vertices, scene)


def test_a_turned_scene_gives_the_turned_garment(scene):
    """Adam would not: it scales every coordinate by itself."""
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix().astype(np.float32)
    inputs = scene["inputs"]
    turned = {name: np.asarray(inputs[name]) @ turn.T for name in ("positions", "normals")}
    turned["body"] = (inputs["body"][0] @ turn.T, inputs["body"][1])
    want = solved(scene).vertices @ turn.T
    apart = np.linalg.norm(solved(scene, **turned).vertices - want, axis=-1)
    # Rounding is carried on; where a vertex may go two ways round the body it may take the other one.
    assert np.median(apart) < 1e-5
    assert np.quantile(apart, 0.99) < 5e-4


@pytest.mark.parametrize("solver", SOLVERS)
def test_pinned_vertices_stay_exactly_where_they_are_wanted(scene, solver):
    pinned = np.array([3, 40, 41, 100])
    wanted = scene["truth"][:, pinned] * np.array([0.9, 1.0, 0.9], np.float32)  # some 13 mm towards the body
    config = FusionConfig(solver=solver, clearance_m=0.02)
    result = solved(scene, config, pins=(pinned, wanted))
    np.testing.assert_array_equal(result.vertices[:, pinned], wanted)
    np.testing.assert_array_equal(result.initial[:, pinned], wanted)
    free = solved(scene, config)
    assert not np.array_equal(free.vertices[:, pinned], wanted)
    kept = solved(scene, config, pins=(pinned, None))
    np.testing.assert_array_equal(kept.vertices[:, pinned], kept.initial[:, pinned])
    # Their neighbours follow.
    edges = scene["imager"].mesh.edges
    near = np.setdiff1d(edges[np.isin(edges, pinned).any(1)], pinned)
    assert np.linalg.norm(result.vertices - free.vertices, axis=-1)[:, near].mean() > 1e-3


def test_everything_pinned_is_returned_as_given(scene):
    pinned = np.arange(scene["truth"].shape[1])
    result = solved(scene, pins=(pinned, scene["truth"]))
    np.testing.assert_array_equal(result.vertices, scene["truth"])


@pytest.mark.parametrize("solver", SOLVERS)
def test_confidence_of_one_everywhere_is_as_none(scene, solver):
    config = FusionConfig(solver=solver, edge_steps=3, normal_steps=3)
    ones = np.ones(scene["inputs"]["positions"].shape[:4], np.float32)
    want = solved(scene, config).vertices
    np.testing.assert_array_equal(solved(scene, config, confidence=ones).vertices, want)


@pytest.mark.parametrize("solver", SOLVERS)
def test_pixels_without_confidence_do_not_count_whatever_they_hold(scene, solver):
    """A patch of the front is spoilt. Ignored, it does no harm, and what it holds makes no difference."""
    config = FusionConfig(solver=solver)
    inputs = scene["inputs"]
    patch = (slice(None), 0, slice(24, 40), slice(26, 38))
    confidence = np.ones(inputs["positions"].shape[:4], np.float32)
    confidence[patch] = 0
    results = []
    for shift in (0.05, -0.3):
        spoilt = {name: inputs[name].clone() for name in ("positions", "normals")}
        spoilt["positions"][patch] += shift
        spoilt["normals"][patch] *= -1
        results.append(solved(scene, config, **spoilt, confidence=confidence))
    np.testing.assert_array_equal(results[0].vertices, results[1].vertices)
    trusting = FusionConfig(solver=solver, automatic_confidence=False)
    trusted = solved(scene, trusting, **spoilt)
    clean = error_mm(solved(scene, config).vertices, scene)
    assert error_mm(results[0].vertices, scene) < 1.5 * clean
    assert error_mm(trusted.vertices, scene) > 3 * clean
    assert results[0].report["unseen_percent"] > trusted.report["unseen_percent"]


def test_a_view_of_less_confidence_counts_less_where_two_views_see_a_vertex(scene):
    imager = TemplateImager.build(tube(), views=("front", "left"), size=(64, 64))
    both = imager.visible.all(axis=0)
    assert both.sum() > 10
    maps = torch.zeros(1, *imager.mask.shape, 3)
    maps[:, 1] = imager.mask[1][..., None].float()  # the left view says 1 m, the front 0
    confidence = torch.ones(maps.shape[:4])

    def read(trust):
        confidence[:, 1] = trust
        config = FusionConfig(edge_iterations=0)
        return fuse(imager, inputs_of(positions=maps, confidence=confidence), config).vertices[0, both, 0]

    much, little = read(2.0), read(0.1)
    # Weights w and 1 - w at equal confidence: w c / (w c + 1 - w) at c.
    equal = read(1.0)
    np.testing.assert_allclose(much, 2 * equal / (1 + equal), atol=1e-5)
    np.testing.assert_allclose(little, 0.1 * equal / (1 - 0.9 * equal), atol=1e-5)


def test_less_confident_positions_hold_vertices_less(scene):
    confidence = torch.ones(scene["inputs"]["positions"].shape[:4])
    config = FusionConfig(edge_iterations=100)
    moved = []
    for trust in (0.999, 0.05):
        confidence[:] = trust
        result = solved(scene, config, normals=None, body=None, confidence=confidence)
        moved.append(np.linalg.norm(result.vertices - result.initial, axis=-1).mean())
    assert moved[1] > 1.1 * moved[0]


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_warm_start_begins_where_the_frame_before_ended(scene, solver):
    """The same frame three times: each warm start goes on from the last one's end, to edges nearer to their lengths."""
    few = {
        "edge_iterations": 4,
        "normal_iterations": 4,
        "edge_steps": 8,
        "normal_steps": 8,
        "batch_frames": 1,
    }
    bodies, faces = scene["inputs"]["body"]
    same = {
        name: np.repeat(np.asarray(scene["inputs"][name])[:1], 3, axis=0) for name in ("positions", "normals")
    }
    same["body"] = (np.repeat(bodies[:1], 3, axis=0), faces)
    config = FusionConfig(solver=solver, **few)
    cold, warm = (
        solved(scene, config.model_copy(update={"warm_start": on}), **same).vertices for on in (False, True)
    )
    np.testing.assert_array_equal(warm[0], cold[0])
    strains = edge_length_loss(torch.from_numpy(warm), Topology(scene["imager"].mesh)).tolist()
    assert strains[2] < strains[1] < strains[0]
    batched = solved(
        scene, config.model_copy(update={"warm_start": True, "batch_frames": 8}), **same
    ).vertices
    np.testing.assert_array_equal(warm, batched)


def test_a_frame_that_is_finished_stops_and_the_others_go_on(scene):
    """The second frame's maps are exact, those of the others blurred: it needs fewer steps."""
    inputs = scene["inputs"]["positions"].clone()
    inputs[1] = true_maps(scene["imager"], torch.from_numpy(scene["truth"]))[0][1]
    found = {
        batch: fuse(scene["imager"], inputs_of(positions=inputs), FusionConfig(batch_frames=batch))
        for batch in (1, 3)
    }
    alone = [
        fuse(scene["imager"], inputs_of(positions=inputs[[k]])).report["iterations"]["edge"] for k in range(3)
    ]
    assert alone[1] != alone[0]
    assert found[3].report["iterations"]["edge"] == pytest.approx(np.mean(alone))
    np.testing.assert_allclose(found[3].vertices, found[1].vertices, atol=1e-5)


def test_history_holds_every_iteration_of_every_term(scene):
    numbers = {"edge_iterations": 7, "edge_tolerance": 0.0, "normal_iterations": 8, "normal_tolerance": 0.0}
    for solver, counts in (("local_global", (7, 8)), ("adam", (5, 6))):
        config = FusionConfig(solver=solver, edge_steps=5, normal_steps=6, **numbers)
        result = fuse(scene["imager"], inputs_of(**scene["inputs"]), config, history=True)
        report = result.report
        assert report["solver"] == solver
        for stage, count in zip(("edge", "normal"), counts, strict=True):
            assert set(report["history"][stage]) == {*report["terms"][stage]["end"], "total"}
            for name, curve in report["history"][stage].items():
                assert len(curve) == count + 1
                ends = report["total"][stage] if name == "total" else None
                start = ends["start"] if ends else report["terms"][stage]["start"][name]
                end = ends["end"] if ends else report["terms"][stage]["end"][name]
                assert (curve[0], curve[-1]) == (start, end)
            assert report["iterations"][stage] == count
    assert "history" not in solved(scene).report


@pytest.mark.parametrize("solver", SOLVERS)
def test_the_collision_term_is_of_the_vertices_that_are_returned(scene, solver):
    sunk = scene["inputs"]["positions"] * torch.tensor([0.85, 1.0, 0.85])
    result = solved(scene, {"solver": solver, "clearance_rounds": 0}, positions=sunk)
    bodies, faces = scene["inputs"]["body"]
    sdf = BodySdf(faces, bodies.shape[1])
    sdf.update(bodies)
    depth = (-sdf.query(torch.from_numpy(result.vertices)).distance).clamp(min=0).mean()
    assert result.report["terms"]["normal"]["end"]["collision_m"] == pytest.approx(depth.item(), abs=1e-7)
    assert result.report["terms"]["normal"]["start"]["collision_m"] > 1e-4


def odd_mesh():
    """A tube with a face without area, an edge of three faces, a loose triangle out of sight, and a lone vertex."""
    whole = tube()
    n = len(whole.vertices)
    inside = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])
    fin = whole.vertices[[5]] * np.array([1.1, 1, 1.1])
    vertices = np.concatenate([whole.vertices, inside, fin, [[0, 0.02, 0]]])
    first, second = whole.faces[20, :2]
    extra = np.array([[n, n + 1, n + 2], [first, first, second], [first, second, n + 3]])
    return Mesh(vertices, np.concatenate([whole.faces, extra]), source="odd")


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_odd_mesh_is_fused_all_the_same(solver):
    mesh = odd_mesh()
    imager = imager_of(mesh, (64, 64))
    assert not imager.visible.any(0).all()
    truth = torch.from_numpy(mesh.vertices).float()[None]
    positions, normals = true_maps(imager, truth)
    body = cylinder_body()
    result = fuse(
        imager,
        inputs_of(positions=positions, normals=normals, body=(np.asarray(body.vertices)[None], body.faces)),
        FusionConfig(solver=solver, edge_steps=20, normal_steps=20),
    )
    assert np.isfinite(result.vertices).all()
    whole = len(tube().vertices)
    error = np.linalg.norm(result.vertices[0, :whole] - mesh.vertices[:whole], axis=-1)
    assert np.median(error) < 0.003


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_single_triangle_is_fused(solver):
    mesh = Mesh(np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.4, 0]]), np.array([[0, 1, 2]]))
    imager = imager_of(mesh)
    truth = torch.from_numpy(mesh.vertices).float()[None] + 0.1
    positions, normals = true_maps(imager, truth)
    config = FusionConfig(solver=solver, edge_steps=20, normal_steps=20)
    found = fuse(imager, inputs_of(positions=positions, normals=normals), config).vertices
    # Corners lie on the outline, half a pixel beyond the last pixel's centre: 4 mm.
    np.testing.assert_allclose(found, truth, atol=6e-3)


@pytest.mark.parametrize(
    "left_out", ["weight_edge", "weight_displacement", "weight_consistency", "weight_collision"]
)
def test_every_weight_may_be_zero(scene, left_out):
    result = solved(scene, {left_out: 0.0})
    assert np.isfinite(result.vertices).all()
    assert result.report["total"]["normal"]["end"] < result.report["total"]["normal"]["start"]


def test_a_garment_beneath_is_kept_out_of(scene):
    mesh = tube()
    inner = leaning(mesh.vertices * np.array([0.99, 1.0, 0.99]), 3)
    sunk = scene["inputs"]["positions"] * torch.tensor([0.97, 1.0, 0.97])
    inputs = {"positions": sunk, "normals": scene["inputs"]["normals"]}
    result = fuse(scene["imager"], inputs_of(**inputs, inner=(inner, mesh.faces)))
    assert result.report["penetration_percent"]["after"] == 0
    without = fuse(scene["imager"], inputs_of(**inputs))
    radius = np.linalg.norm(result.vertices - without.vertices, axis=-1)
    assert radius.max() > 0.002


def test_a_frame_in_which_nothing_visible_has_confidence_is_refused(scene):
    confidence = np.ones(scene["inputs"]["positions"].shape[:4], np.float32)
    confidence[1] = 0
    with pytest.raises(InputError, match="frame 1"):
        solved(scene, confidence=confidence)
