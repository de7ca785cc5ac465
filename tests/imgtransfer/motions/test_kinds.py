"""Joint-angle curves: the random curves they are made of, and what each kind of motion is."""

import numpy as np
import pytest

from imgtransfer.bodies.smpl import INDEX, global_rotations, segment_direction
from imgtransfer.motions.kinds import KINDS, Clock, pulse
from imgtransfer.motions.library import make_motion
from imgtransfer.motions.limits import LIMITS, SIDES, within_limits

RATE = 30.0


def clock(seed=0, *, length=4.0, tempo=1.0):
    time = np.arange(round(length * RATE) + 1) / RATE
    return Clock(time, RATE, tempo, np.random.default_rng(seed))


def angles(kind, seed=0, **options):
    return KINDS[kind](clock(seed, **options))


@pytest.mark.parametrize(("sharpness", "quarter"), [(1.0, 0.5), (2.0, 0.25), (4.0, 0.0625)])
def test_a_pulse_rises_once_a_cycle(sharpness, quarter):
    phase = np.array([0, np.pi / 2, np.pi, 3 * np.pi / 2, 2 * np.pi, 3 * np.pi])
    np.testing.assert_allclose(pulse(phase, sharpness), [0, quarter, 1, quarter, 0, 1], atol=1e-12)


@pytest.mark.parametrize("tempo", [0.5, 1.0, 2.0])
def test_a_phase_advances_by_about_its_frequency(tempo):
    for seed in range(10):
        phase = clock(seed, tempo=tempo).phase(0.8)
        hertz = np.diff(phase) * RATE / (2 * np.pi)
        assert np.ptp(hertz) < 1e-9
        assert 0.85 <= hertz[0] / (0.8 * tempo) <= 1.15
        assert 0 <= phase[0] <= 2 * np.pi


def test_phases_start_anywhere():
    starts = np.array([clock(seed).phase(1.0)[0] for seed in range(40)])
    assert np.histogram(starts, 4, (0, 2 * np.pi))[0].min() > 3


def test_random_curves_stay_between_their_limits_use_them_and_are_smooth():
    curves = np.stack([clock(seed, length=10).between(-3, 7, seconds=0.8) for seed in range(10)])
    assert curves.min() >= -3
    assert curves.max() <= 7
    assert curves.min() < -2
    assert curves.max() > 6
    # From limit to limit within the shortest step of 0.56 s, a cubic is at most 1.5 times as steep as a line.
    assert np.abs(np.diff(curves, axis=1)).max() * RATE <= 1.5 * 10 / 0.56


def test_a_faster_tempo_has_more_goals_in_the_same_time():
    def turns(tempo):
        curves = [clock(seed, length=20, tempo=tempo).wander(1.0, seconds=2.0) for seed in range(5)]
        return sum((np.diff(np.sign(np.diff(curve))) != 0).sum() for curve in curves)

    assert 1.6 < turns(2.0) / turns(1.0) < 2.5


def test_an_amplitude_stays_near_its_value():
    values = np.stack([clock(seed).around(40.0, 0.2) for seed in range(30)])
    # Chosen within a fifth of it, and drifting by a tenth of that.
    assert values.min() >= 40 * 0.8 * 0.9
    assert values.max() <= 40 * 1.2 * 1.1
    assert np.ptp(values.mean(axis=1)) > 8


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_gives_finite_curves_of_known_angles_decided_by_the_seed(kind):
    curves = angles(kind)
    assert set(curves) - {"hop", "forward", "sideways"} <= set(LIMITS)
    frames = len(clock().time)
    for name, curve in curves.items():
        assert curve.shape == (frames,), name
        assert np.isfinite(curve).all(), name
    again, other = angles(kind), angles(kind, seed=1)
    assert all(np.array_equal(curves[name], again[name]) for name in curves)
    assert not all(np.array_equal(curves[name], other.get(name)) for name in curves)


@pytest.mark.parametrize("kind", KINDS)
def test_a_single_frame_is_a_pose(kind):
    curves = angles(kind, length=0.0)
    assert all(curve.shape == (1,) and np.isfinite(curve).all() for curve in curves.values())


@pytest.mark.parametrize(("kind", "hop"), [("run", 0.06 * 1.3), ("jump", 0.25 * 1.2)])
def test_only_runs_and_jumps_leave_the_ground_and_never_sink_into_it(kind, hop):
    heights = np.concatenate([angles(kind, seed)["hop"] for seed in range(6)])
    assert heights.min() >= 0
    assert 0.5 * hop < heights.max() <= hop
    assert [name for name in KINDS if name != "mixed" and "hop" in angles(name)] == ["run", "jump"]


@pytest.mark.parametrize("kind", ["walk", "run"])
def test_legs_swing_in_turn_and_each_arm_with_the_other_leg(kind):
    curves = angles(kind, length=8)

    def together(one, other):
        return np.corrcoef(curves[one], curves[other])[0, 1]

    assert together("left_hip", "right_hip") < -0.9
    assert together("left_hip", "right_swing") > 0.7
    assert together("left_hip", "left_swing") < -0.7
    assert curves["left_knee"].min() >= 0


def test_a_squat_bends_hips_and_knees_of_both_sides_together():
    curves = angles("squat", length=8)
    assert np.array_equal(curves["left_knee"], curves["right_knee"])
    np.testing.assert_allclose(curves["left_hip"] * 100, curves["left_knee"] * 85)
    assert np.ptp(curves["left_knee"]) > 70


def test_leaning_tilts_hips_and_spine_to_all_sides():
    several = [angles("lean", seed) for seed in range(8)]
    tilts = {name: np.concatenate([curves[name] for curves in several]) for name in ("pitch", "roll", "bend")}
    for name, least, most in (("pitch", -12, 45), ("roll", -16, 16), ("bend", -15, 45)):
        assert least <= tilts[name].min() < least + 0.2 * (most - least), name
        assert most >= tilts[name].max() > most - 0.2 * (most - least), name


def test_who_leans_stands_on_legs_that_are_upright_whichever_way_the_hips_tilt():
    for seed in range(8):
        motion = make_motion("lean", seed=seed, seconds=4)
        rotations = global_rotations(motion.poses)
        for side in SIDES:
            hip, knee = INDEX[f"{side}_hip"], INDEX[f"{side}_knee"]
            down = rotations[:, hip] @ segment_direction("thigh", side)
            down = down + rotations[:, knee] @ segment_direction("shin", side)
            tilt = np.degrees(np.arccos(-down[:, 1] / np.linalg.norm(down, axis=1)))
            # Feet are apart by 8 degrees of either thigh, over which knees bend by 35 at most.
            assert tilt.max() < 15


def test_a_kick_swings_one_leg_at_a_time():
    left, right = (angles("kick", length=12)[f"{side}_hip"] for side in ("left", "right"))
    assert left.max() > 40
    assert right.max() > 40
    assert np.minimum(left, right).max() < 15


def test_lunges_take_legs_through_all_of_their_range():
    several = [angles("lunge", seed) for seed in range(8)]
    for name, least, most in (("hip", -22, 85), ("spread", 0, 38), ("turn_out", -20, 35), ("knee", 4, 95)):
        values = np.concatenate([curves[f"{side}_{name}"] for curves in several for side in SIDES])
        assert least <= values.min() < least + 0.2 * (most - least), name
        assert most >= values.max() > most - 0.2 * (most - least), name


def test_turning_goes_farther_than_walking_does():
    def turned(kind):
        return np.mean([np.ptp(angles(kind, seed)["yaw"]) for seed in range(8)])

    assert turned("turn") > 3 * turned("walk")


def test_random_poses_need_no_clipping():
    for seed in range(5):
        curves = angles("random", seed)
        limited = within_limits(curves, len(clock().time))
        assert all(np.array_equal(limited[name], curves[name]) for name in curves)


def test_mixed_motions_have_the_legs_of_several_kinds_under_moving_arms():
    mixed = [angles("mixed", seed) for seed in range(11, 25)]
    assert any("hop" in curves for curves in mixed)  # a run's legs
    assert any("pitch" in curves for curves in mixed)  # a squat's
    assert any("left_knee" not in curves for curves in mixed)  # somebody who stands
    for curves in mixed:
        for name in ("bend", "look", "left_raise", "right_elbow"):
            assert np.ptp(curves[name]) > 1, name
