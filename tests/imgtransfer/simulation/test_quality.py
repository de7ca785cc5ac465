import numpy as np
import pytest

from fusion import BodySdf
from imgtransfer.simulation.config import GateConfig
from imgtransfer.simulation.quality import CLEARANCE, energy_spike, faults, jitter, measure, push_out
from render.mesh.mesh import Mesh

# A tetrahedron-like body: an octahedron with corners one metre from the origin.
CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float32)
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
# A square sheet above the top corner.
SHEET = Mesh(
    np.array([[0, 1.1, 0], [0, 1.1, 1], [1, 1.1, 1], [1, 1.1, 0]], np.float64),
    np.array([[0, 1, 2], [0, 2, 3]]),
)


def quality_of(frames, body=None, before=None, after=None, fps=30.0):
    frames = np.asarray(frames, np.float64)
    body = np.tile(CORNERS, (len(frames), 1, 1)) if body is None else body
    outside = np.full(frames.shape[:2], 0.1)
    before = outside if before is None else before
    after = outside if after is None else after
    return measure(SHEET, frames, body, FACES, rest=CORNERS, before=before, after=after, fps=fps)


def test_a_sheet_at_rest_has_no_fault():
    quality = quality_of([SHEET.vertices] * 3)
    assert quality.median_stretch == 0
    assert quality.p99_stretch == pytest.approx(1)
    assert quality.speed == 0
    assert quality.reach == pytest.approx(0.1)
    assert faults(quality, GateConfig()) == []


def test_a_doubled_sheet_is_stretched_twofold():
    quality = quality_of([SHEET.vertices, 2 * SHEET.vertices])
    assert quality.median_stretch == pytest.approx(1)
    assert [fault.split()[0] for fault in faults(quality, GateConfig(speed=1e9))] == [
        "median_stretch",
        "p99_stretch",
    ]


def test_one_torn_frame_of_many_fails_though_the_clip_as_a_whole_does_not():
    frames = np.stack([SHEET.vertices] * 199 + [3 * SHEET.vertices])
    quality = quality_of(frames)
    assert quality.p99_stretch == pytest.approx(1)
    assert quality.worst_p99_stretch == pytest.approx(3)
    wrong = faults(quality, GateConfig(speed=1e9, median_stretch=1e9))
    assert [fault.split()[0] for fault in wrong] == ["worst_p99_stretch"]


def test_speed_is_measured_against_the_body():
    away = SHEET.vertices + np.array([0.5, 0, 0])
    still = quality_of([SHEET.vertices, away])
    assert still.speed == pytest.approx(15)  # 0.5 m in 1/30 s
    assert any("speed" in fault for fault in faults(still, GateConfig()))
    together = quality_of([SHEET.vertices, away], body=np.stack([CORNERS, CORNERS + np.array([0.5, 0, 0])]))
    assert together.speed == pytest.approx(0)


def test_sunk_and_penetrating_shares_and_reach():
    before = np.array([[-0.01, 0.1, 0.1, 0.1], [-0.03, -0.02, 0.1, 0.1]])
    quality = quality_of([SHEET.vertices] * 2, before=before, after=np.abs(before) * 4)
    assert quality.sunk_percent == pytest.approx(37.5)
    assert quality.deepest == pytest.approx(0.03)
    assert quality.penetration_percent == 0
    assert quality.reach == pytest.approx(0.4)
    assert {fault.split()[0] for fault in faults(quality, GateConfig(reach=0.3))} == {"sunk_percent", "reach"}
    assert quality_of([SHEET.vertices] * 2, after=before).penetration_percent == pytest.approx(37.5)


def test_a_corner_through_the_sheet_fails_though_no_vertex_is_inside():
    """The top corner of the octahedron through one face of the sheet, in one of two frames."""
    through = SHEET.vertices - np.array([0.1, 0.2, 0.4])
    quality = quality_of([SHEET.vertices, through])
    assert quality.penetration_percent == 0
    # Body: the edges from the top corner to -x, z and -z pass; +x leaves beside. Garment: none of its five.
    assert quality.crossing_percent > 0
    wrong = faults(quality, GateConfig(speed=1e9))
    assert [fault.split()[0] for fault in wrong] == ["crossing_percent"]
    assert quality_of([SHEET.vertices] * 2).crossing_percent == 0


def test_an_exploded_clip_fails_every_gate():
    frames = np.stack([SHEET.vertices, SHEET.vertices])
    frames[1, 2] = np.nan
    assert len(faults(quality_of(frames), GateConfig())) == len(GateConfig.model_fields)


def test_push_out_moves_only_what_is_inside_to_the_surface():
    sdf = BodySdf(FACES, len(CORNERS))
    sdf.update(CORNERS)
    normal = np.ones(3) / np.sqrt(3)  # of the face x + y + z = 1
    inside = normal / np.sqrt(3) - 0.02 * normal
    points = np.stack([inside, normal, -2 * normal]).astype(np.float32)
    pushed, before, after = push_out(points, sdf)
    np.testing.assert_allclose(before[0], -0.02, atol=1e-5)
    np.testing.assert_allclose(pushed[0], normal / np.sqrt(3) + CLEARANCE * normal, atol=1e-5)
    assert np.array_equal(pushed[1:], points[1:])
    assert after.min() >= 0.9 * CLEARANCE


def waving(frames=20, hertz=1.0, size=0.5):
    """A sheet that turns about its first corner, as fast cloth may."""
    angle = size * np.sin(2 * np.pi * hertz * np.arange(frames) / 30)
    x, y, z = (SHEET.vertices - SHEET.vertices[0]).T
    return np.stack([np.cos(angle)[:, None] * x - np.sin(angle)[:, None] * z, np.broadcast_to(y, (frames, 4)),
                     np.sin(angle)[:, None] * x + np.cos(angle)[:, None] * z], axis=-1)  # fmt: skip


def test_a_sheet_that_moves_as_a_whole_or_swings_has_no_energy_spike():
    flying = SHEET.vertices + np.arange(20)[:, None, None] ** 2 * 0.01
    assert energy_spike(SHEET, flying, 30.0) == pytest.approx(1)
    assert energy_spike(SHEET, waving(), 30.0) < 2


def test_one_vertex_that_jumps_for_a_frame_is_an_energy_spike_by_hand():
    frames = waving(size=0.0)
    frames[10, 1] += [0, 0.2, 0]
    # It belongs to one of the two triangles: a sixth of the mass at 6 m/s, apart from the mean of 1 m/s.
    mass, speed = 1 / 6, 6.0
    energy = 0.5 * (mass * (speed - mass * speed) ** 2 + (1 - mass) * (mass * speed) ** 2)
    assert energy_spike(SHEET, frames, 30.0) == pytest.approx(energy / (0.5 * 0.5**2))
    quality = quality_of(frames)
    assert any(fault.startswith("energy_spike") for fault in faults(quality, GateConfig(speed=1e9)))


def test_jitter_counts_only_while_the_body_rests():
    frames = np.tile(SHEET.vertices, (12, 1, 1))
    frames[::2] += [0, 0.003, 0]
    resting = np.tile(CORNERS, (12, 1, 1))
    assert jitter(frames, resting, 30.0) == pytest.approx(0.003)
    assert any(fault.startswith("jitter") for fault in faults(quality_of(frames), GateConfig()))
    walking = resting + np.arange(12)[:, None, None] * np.array([0.01, 0, 0])  # 0.3 m/s
    assert jitter(frames, walking, 30.0) == 0
    assert jitter(frames[:2], resting[:2], 30.0) == 0
