import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from imgtransfer.bodies.smpl import INDEX, global_rotations, segment_direction
from imgtransfer.motions.kinds import KINDS, Clock
from imgtransfer.motions.library import FASTEST_FALL, _travelled, falling_slower, make_motion
from imgtransfer.motions.limits import LIMITS, NEUTRAL, poses_from_angles, within_limits
from imgtransfer.motions.motion import Motion, arms_out, resample
from render import InputError


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_smooth_starts_standing_and_stays_within_limits(kind):
    clock = Clock(np.arange(120) / 30, 30.0, 1.0, np.random.default_rng(3))
    curves = KINDS[kind](clock)
    unknown = set(curves) - set(LIMITS) - {"hop", "forward", "sideways"}
    assert not unknown
    for name, values in within_limits(curves, 120).items():
        low, high = LIMITS[name]
        assert values.shape == (120,)
        assert values.min() >= low
        assert values.max() <= high
    motion = make_motion(kind, seed=3, seconds=4)
    assert motion.poses.shape == (120, 22, 3)
    still = poses_from_angles({name: np.array([value]) for name, value in NEUTRAL.items()})
    np.testing.assert_allclose(motion.poses[0], still[0], atol=1e-12)
    turned = Rotation.from_rotvec(motion.poses.reshape(-1, 3)).as_matrix().reshape(120, 22, 3, 3)
    steps = np.einsum("tjab,tjac->tjbc", turned[:-1], turned[1:])
    speed = Rotation.from_matrix(steps.reshape(-1, 3, 3)).magnitude().max() * 30
    assert speed < np.radians(700)  # a fast punch; nothing flips
    fastest = 4.0 if kind == "dash" else 3.0  # m/s
    assert np.abs(np.diff(motion.trans, axis=0)).max() * 30 < fastest
    assert np.abs(np.diff(motion.poses[:, 1:], axis=0)).max() > 1e-4  # it moves


@pytest.mark.parametrize("kind", KINDS)
def test_the_seed_alone_decides(kind):
    first, again, other = (make_motion(kind, seed=seed, seconds=2) for seed in (5, 5, 6))
    assert np.array_equal(first.poses, again.poses)
    assert np.array_equal(first.trans, again.trans)
    assert np.abs(first.poses - other.poses).max() > 0.02


def test_a_dash_starts_and_stops_harder_than_running_does():
    def accelerations(kind):
        ways = np.stack([make_motion(kind, seed=seed, seconds=3).trans[20:, [0, 2]] for seed in range(5)])
        speeds = gaussian_filter1d(np.diff(ways, axis=1) * 30, 2, axis=1)
        return np.linalg.norm(np.diff(speeds, axis=1) * 30, axis=-1)

    assert np.percentile(accelerations("dash"), 90) > 3  # m/s²; a tilt of gravity by 17 degrees
    assert np.percentile(accelerations("dash"), 90) > 1.5 * np.percentile(accelerations("run"), 90)


def test_speeds_are_along_where_the_pelvis_faces_by_hand():
    pelvis = Rotation.from_rotvec(
        [
            [0, 0, 0],
            [0, np.pi / 2, 0],  # facing +x, its left is -z
            [np.radians(60), 0, 0],  # pitched forward, which makes it no slower
        ]
    ).as_matrix()
    speeds = np.array([[0.0, 2.0, 0.0], [3.0, 0.0, 1.0]])  # to the left, ahead; m/s
    way = _travelled(pelvis, speeds, 10.0)
    np.testing.assert_allclose(way, [[0, 0, 0.3], [0, 0, 0.1], [0, 0, 0.2]], atol=1e-12)


def test_walking_goes_forward_and_squatting_goes_down():
    way = make_motion("walk", seed=1, seconds=4).trans
    assert way[-1, 2] > 1.0
    height = make_motion("squat", seed=1, seconds=4).trans[:, 1]
    assert height.max() - height.min() > 0.15


def test_a_path_falls_no_faster_than_allowed_by_hand():
    # A step down from 1 m becomes a parabola that ends where the step does; what is gentle stays.
    step = np.where(np.arange(30) < 15, 1.0, 0.0)
    path = falling_slower(step, 30.0)
    assert np.all(path <= step + 1e-12)
    assert np.diff(path, 2).min() * 900 == pytest.approx(-FASTEST_FALL)
    fallen = FASTEST_FALL / 2 * (np.arange(30) / 30) ** 2
    np.testing.assert_allclose(
        path[:15], (1 - fallen)[:15] - (1 - fallen[15]) * np.arange(15) / 15, atol=1e-9
    )
    gentle = 0.05 * np.sin(np.arange(60) / 10)
    np.testing.assert_allclose(falling_slower(gentle, 30.0), gentle, atol=1e-12)


@pytest.mark.parametrize("kind", ["run", "jump"])
def test_nobody_falls_away_from_the_clothes(kind):
    for seed in range(4):
        height = make_motion(kind, seed=seed, seconds=3).trans[:, 1]
        assert np.diff(height, 2).min() * 900 > -1.01 * FASTEST_FALL


def test_hanging_arm_and_raised_arm_by_hand():
    angles = within_limits({"left_raise": np.array([90.0]), "right_raise": np.array([20.0])}, 1)
    rotations = global_rotations(poses_from_angles(angles))[0]
    left = rotations[INDEX["left_shoulder"]] @ segment_direction("upper_arm", "left")
    np.testing.assert_allclose(
        left, segment_direction("upper_arm", "left"), atol=1e-9
    )  # level, as in the T-pose
    right = rotations[INDEX["right_shoulder"]] @ np.array([-1.0, 0, 0])
    np.testing.assert_allclose(right, [-np.sin(np.radians(20)), -np.cos(np.radians(20)), 0], atol=1e-9)


def test_bending_turns_the_chest_forward_by_that_angle():
    rotations = global_rotations(poses_from_angles(within_limits({"bend": np.array([50.0])}, 1)))[0]
    np.testing.assert_allclose(
        rotations[INDEX["spine3"]] @ [0, 1, 0], [0, np.cos(np.radians(50)), np.sin(np.radians(50))], atol=1e-9
    )


def test_arms_out_turns_hanging_arms_by_the_angle_and_leaves_level_ones():
    angles = within_limits({"left_raise": np.array([14.0, 14.0]), "right_raise": np.array([90.0, 90.0])}, 2)
    motion = Motion(poses_from_angles(angles), np.zeros((2, 3)), 30.0, "m")
    before, after = global_rotations(motion.poses)[0], global_rotations(arms_out(motion, 6).poses)[0]

    def turn(joint):
        return np.degrees(Rotation.from_matrix(before[INDEX[joint]].T @ after[INDEX[joint]]).magnitude())

    assert turn("left_shoulder") == pytest.approx(6, abs=1e-6)
    assert turn("left_wrist") == pytest.approx(6, abs=1e-6)
    assert turn("right_shoulder") == pytest.approx(0, abs=1e-6)
    outward = after[INDEX["left_shoulder"]] @ segment_direction("upper_arm", "left")
    assert outward[0] > (before[INDEX["left_shoulder"]] @ segment_direction("upper_arm", "left"))[0]


@pytest.mark.parametrize("fps", [30.0, 24.0, 59.94, 120.0])
def test_resampling_follows_time_on_an_even_turn(fps):
    time = np.arange(101) / 50.0
    poses = np.zeros((101, 22, 3))
    poses[:, 3, 1] = 1.3 * time  # radians about y at 1.3 a second
    motion = resample(Motion(poses, np.stack([time, 0 * time, 0 * time], axis=1), 50.0, "turn"), fps)
    assert motion.fps == fps
    assert len(motion.poses) == int(2 * fps) + 1
    wanted = np.arange(len(motion.poses)) / fps
    np.testing.assert_allclose(motion.poses[:, 3, 1], 1.3 * wanted, atol=1e-9)
    np.testing.assert_allclose(motion.trans[:, 0], wanted, atol=1e-9)


def test_resampling_at_the_same_rate_changes_nothing():
    motion = make_motion("walk")
    assert resample(motion, 30.0) is motion


@pytest.mark.parametrize(("arguments", "text"), [
    ({"kind": "fly"}, "not in the library"),
    ({"kind": "walk", "tempo": 0.0}, "tempo"),
    ({"kind": "walk", "seconds": -1}, "seconds"),
    ({"kind": "walk", "fps": 0}, "fps"),
])  # fmt: skip
def test_bad_arguments_are_named(arguments, text):
    with pytest.raises(InputError, match=text):
        make_motion(**arguments)


def test_a_motion_that_is_not_finite_is_refused():
    poses = np.zeros((3, 22, 3))
    poses[1, 4, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        Motion(poses, np.zeros((3, 3)), 30.0, "broken")
