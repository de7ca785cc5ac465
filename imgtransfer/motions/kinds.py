"""Joint-angle curves of every kind of motion, in degrees over time; amplitudes and phases vary by seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from imgtransfer.motions.limits import LIMITS, NEUTRAL, SIDES

Angles = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Clock:
    """What a kind of motion draws from.

    Args:
        time: (T,) seconds. rate: frames a second. tempo: 1 is usual, 2 twice as fast. random: the seed's generator.
    """

    time: np.ndarray
    rate: float
    tempo: float
    random: np.random.Generator

    def phase(self, hertz: float) -> np.ndarray:
        """(T,) radians of a cycle of about `hertz` times the tempo, from a random start."""
        hertz = hertz * self.tempo * self.random.uniform(0.85, 1.15)
        return 2 * np.pi * hertz * self.time + self.random.uniform(0, 2 * np.pi)

    def around(self, value: float, spread: float = 0.25) -> np.ndarray:
        """(T,) an amplitude near `value` that drifts slowly by up to `spread` of it either way."""
        slow = self.wander(1.0, seconds=2.5)
        return value * self.random.uniform(1 - spread, 1 + spread) * (1 + 0.5 * spread * slow)

    def wander(self, size: float, *, seconds: float, centre: float = 0.0) -> np.ndarray:
        """(T,) a smooth random curve within `centre` ± `size`, with a new goal about every `seconds` / tempo."""
        return self.between(centre - size, centre + size, seconds=seconds)

    def between(self, low: float, high: float, *, seconds: float) -> np.ndarray:
        """(T,) a smooth random curve in [low, high] with a new goal about every `seconds` / tempo."""
        end, keys = self.time[-1], [0.0]
        while keys[-1] <= end:
            keys.append(keys[-1] + seconds / self.tempo * self.random.uniform(0.7, 1.3))
        curve = PchipInterpolator(keys, self.random.uniform(low, high, len(keys)))(self.time)
        return gaussian_filter1d(curve, 0.06 * self.rate, mode="nearest")


def pulse(phase: np.ndarray, sharpness: float = 1.0) -> np.ndarray:
    """0 to 1 and back once a cycle, smooth; a larger sharpness makes it shorter."""
    return ((1 - np.cos(phase)) / 2) ** sharpness


def _idle(clock: Clock) -> Angles:
    """Small movements that nobody standing is without."""
    angles = {name: clock.wander(3.0, seconds=1.5) for name in ("bend", "side", "twist")}
    angles |= {"nod": clock.wander(8, seconds=1.2), "look": clock.wander(20, seconds=1.4)}
    for side in SIDES:
        angles[f"{side}_raise"] = clock.between(17, 30, seconds=1.8)
        angles[f"{side}_swing"] = clock.wander(8, seconds=1.6)
        angles[f"{side}_elbow"] = clock.between(8, 35, seconds=1.6)
        angles[f"{side}_roll_in"] = clock.wander(12, seconds=1.6)
    return angles


def _stride(clock: Clock, hertz: float, *, swing: float, lift: float, arms: float, elbow: float) -> Angles:
    phase = clock.phase(hertz)
    angles = _idle(clock)
    for side, shift in (("left", 0.0), ("right", np.pi)):
        own = phase + shift + clock.random.uniform(-0.1, 0.1)
        angles[f"{side}_hip"] = 6 + clock.around(swing, 0.15) * np.sin(own)
        angles[f"{side}_knee"] = 8 + clock.around(lift, 0.2) * pulse(own + np.pi / 2 + 0.4, 1.5)
        angles[f"{side}_ankle"] = 8 * np.sin(own - 1)
        angles[f"{side}_swing"] = -clock.around(arms) * np.sin(own) + clock.random.uniform(-4, 8)
        angles[f"{side}_elbow"] = clock.around(elbow) + 0.4 * arms * pulse(own + np.pi / 2)
    angles["twist"] = angles["twist"] + clock.around(0.35 * arms) * np.sin(phase)
    angles["roll"] = clock.around(3.5) * np.sin(phase + np.pi / 2)
    angles["yaw"] = np.cumsum(clock.wander(18, seconds=2)) / clock.rate
    return angles


def walk(clock: Clock) -> Angles:
    """Walking on a slightly curved path, arms swinging."""
    return _stride(clock, 0.95, swing=24, lift=50, arms=20, elbow=18)


def run(clock: Clock) -> Angles:
    """Running, elbows bent, trunk leaning forward."""
    angles = _stride(clock, 1.35, swing=36, lift=85, arms=30, elbow=75)
    angles["bend"] = angles["bend"] + clock.around(10)
    angles["hop"] = 0.06 * clock.random.uniform(0.6, 1.3) * pulse(2 * clock.phase(1.35))
    return angles


def squat(clock: Clock) -> Angles:
    """Squats, the arms going forward."""
    depth = pulse(clock.phase(0.45)) * clock.around(1.0, 0.15)
    angles = _idle(clock)
    angles |= {"bend": 28 * depth, "pitch": 18 * depth}
    reach = clock.random.uniform(30, 85)
    for side in SIDES:
        angles |= {f"{side}_hip": 85 * depth, f"{side}_knee": 100 * depth, f"{side}_spread": 4 + 14 * depth}
        angles[f"{side}_swing"] = angles[f"{side}_swing"] + reach * depth
    return angles


def jump(clock: Clock) -> Angles:
    """Crouch, leap with the arms up, land."""
    phase = clock.phase(0.6)
    crouch, flight = pulse(phase, 2) * clock.around(1.0, 0.15), pulse(phase + np.pi * 0.9, 4)
    angles = _idle(clock)
    angles |= {
        "bend": 25 * crouch,
        "pitch": 15 * crouch,
        "hop": 0.25 * clock.random.uniform(0.5, 1.2) * flight,
    }
    up = clock.random.uniform(40, 100)
    for side in SIDES:
        angles |= {f"{side}_hip": 60 * crouch + 10 * flight, f"{side}_knee": 80 * crouch + 15 * flight}
        angles[f"{side}_swing"] = -35 * crouch + clock.around(up) * flight
        angles[f"{side}_raise"] = angles[f"{side}_raise"] + clock.random.uniform(0, 40) * flight
    return angles


def bend(clock: Clock) -> Angles:
    """Bending forward from hips and spine, the arms hanging down."""
    depth = pulse(clock.phase(0.3)) * clock.around(1.0, 0.2)
    angles = _idle(clock)
    spine, hips = clock.random.uniform(30, 48), clock.random.uniform(10, 30)
    angles["bend"] = angles["bend"] + spine * depth
    angles["pitch"] = hips * depth
    for side in SIDES:
        angles[f"{side}_hip"] = hips * depth
        angles[f"{side}_knee"] = 4 + clock.random.uniform(5, 25) * depth
        angles[f"{side}_swing"] = angles[f"{side}_swing"] + clock.around(spine + hips, 0.2) * depth
    return angles


def lean(clock: Clock) -> Angles:
    """Leaning to all sides from hips and spine over legs that stay upright, the arms hanging or taken along."""
    angles = _idle(clock)
    pitch = clock.between(-12, 45, seconds=1.1)
    roll = clock.wander(16, seconds=1.3)
    angles |= {"pitch": pitch, "roll": roll}
    angles["bend"] = clock.between(-15, 45, seconds=1.2)
    angles["side"] = clock.wander(20, seconds=1.2)
    angles["twist"] = clock.wander(25, seconds=1.4)
    hanging = clock.random.uniform(0, 1)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        knee = clock.between(4, 35, seconds=1.3)
        angles[f"{side}_hip"] = pitch + 0.5 * knee
        angles[f"{side}_knee"] = knee
        angles[f"{side}_spread"] = 8 - sign * roll
        angles[f"{side}_swing"] = angles[f"{side}_swing"] + hanging * (pitch + angles["bend"])
    return angles


def twist(clock: Clock) -> Angles:
    """Turning the trunk to and fro with raised elbows."""
    angles = _idle(clock)
    turning = np.sin(clock.phase(0.5))
    angles["twist"] = clock.around(34) * turning
    angles["look"] = angles["look"] + 25 * turning
    raised, bent = clock.random.uniform(35, 85), clock.random.uniform(40, 110)
    for side in SIDES:
        angles[f"{side}_raise"] = clock.around(raised)
        angles[f"{side}_elbow"] = clock.around(bent)
        angles[f"{side}_hip"] = np.full_like(turning, 3.0)
    return angles


def reach(clock: Clock) -> Angles:
    """Reaching up, sideways or forward with one arm and then the other."""
    angles = _idle(clock)
    phase = clock.phase(0.4)
    for side, shift, lean in (("left", 0.0, 1.0), ("right", np.pi, -1.0)):
        there = pulse(phase + shift, 1.6)
        angles[f"{side}_raise"] = (
            angles[f"{side}_raise"] + clock.around(clock.random.uniform(15, 115)) * there
        )
        angles[f"{side}_swing"] = angles[f"{side}_swing"] + clock.around(clock.random.uniform(10, 95)) * there
        angles[f"{side}_elbow"] = angles[f"{side}_elbow"] * (1 - 0.7 * there)
        angles["side"] = angles["side"] + lean * clock.around(12) * there
        angles["twist"] = angles["twist"] - lean * clock.around(10) * there
    return angles


def punch(clock: Clock) -> Angles:
    """Boxing: guard, and straight punches from either side."""
    angles = _idle(clock)
    phase = clock.phase(0.75)
    angles["bend"] = angles["bend"] + clock.around(10)
    for side, shift, turning in (("left", 0.0, -1.0), ("right", np.pi, 1.0)):
        hit = pulse(phase + shift, 3)
        angles[f"{side}_swing"] = clock.around(28, 0.2) + clock.around(50, 0.2) * hit
        angles[f"{side}_raise"] = clock.around(28, 0.15) + clock.random.uniform(0, 25) * hit
        angles[f"{side}_elbow"] = clock.around(100, 0.12) * (1 - 0.85 * hit)
        angles[f"{side}_roll_in"] = clock.around(20) + 20 * hit
        angles[f"{side}_knee"] = clock.around(18)
        angles[f"{side}_hip"] = clock.around(12)
        angles["twist"] = angles["twist"] + turning * clock.around(22) * hit
    return angles


def kick(clock: Clock) -> Angles:
    """Kicks with one leg and then the other, the opposite arm swinging forward."""
    angles = _idle(clock)
    phase = clock.phase(0.4)
    for side, other, shift in (("left", "right", 0.0), ("right", "left", np.pi)):
        swing = pulse(phase + shift, 4)
        before = pulse(phase + shift + 0.9, 4)
        angles[f"{side}_hip"] = 4 + clock.around(65) * swing - 15 * before
        angles[f"{side}_knee"] = 6 + 60 * before + 10 * swing
        angles[f"{other}_swing"] = angles[f"{other}_swing"] + clock.around(45) * swing
        angles[f"{side}_swing"] = angles[f"{side}_swing"] - clock.around(25) * swing
        angles["bend"] = angles["bend"] - 6 * swing
    angles["yaw"] = clock.wander(25, seconds=2)
    return angles


# Degrees: thighs as high as the trunk lets them, and feet as far apart as in a deep step.
_WIDE_LEG = {"hip": (-22, 85), "spread": (0, 38), "turn_out": (-20, 35), "knee": (4, 95)}


def lunge(clock: Clock) -> Angles:
    """Deep steps and raised legs to the front, the side and back, on hips that tilt and turn."""
    angles = _random_upper(clock)
    angles |= {"pitch": clock.between(-14, 26, seconds=1.2), "roll": clock.wander(13, seconds=1.2)}
    for side in SIDES:
        for name, (low, high) in _WIDE_LEG.items():
            angles[f"{side}_{name}"] = clock.between(low, high, seconds=0.9)
    angles["yaw"] = np.cumsum(clock.wander(140, seconds=1.2)) / clock.rate
    return angles


def dash(clock: Clock) -> Angles:
    """Starting, running, stopping short and stepping aside, the trunk leaning into it; cloth swings on.

    Beside angles, `forward` and `sideways`: metres a second along where the pelvis faces and to its left.
    """
    forward = clock.between(-0.4, 3.4, seconds=0.8)
    sideways = clock.wander(0.8, seconds=0.9)
    stride = _stride(clock, 1.35, swing=36, lift=85, arms=30, elbow=75)
    share = np.clip(np.hypot(forward, sideways) / 3, 0.25, 1)
    angles = {name: NEUTRAL[name] + share * (values - NEUTRAL[name]) for name, values in stride.items()}
    for name, speed, sign in (("pitch", forward, 3.0), ("roll", sideways, -2.0)):  # degrees per m/s²
        leaning = sign * clock.rate * np.diff(speed, prepend=speed[:1])
        angles[name] = gaussian_filter1d(leaning, 0.08 * clock.rate, mode="nearest")
    angles["yaw"] = np.cumsum(clock.wander(90, seconds=1.2)) / clock.rate
    return angles | {"forward": forward, "sideways": sideways}


def turn(clock: Clock) -> Angles:
    """Turning on the spot in small steps, faster and slower, left and right."""
    angles = _stride(clock, 0.9, swing=9, lift=30, arms=8, elbow=20)
    angles["yaw"] = np.cumsum(clock.wander(200, seconds=1.3)) / clock.rate
    return angles


# How much of a joint's range random poses use, so that they stay upright and plausible.
_RANDOM_SHARE = {
    "pitch": 0.3,
    "roll": 0.35,
    "bend": 0.75,
    "side": 0.6,
    "twist": 0.85,
    "nod": 0.7,
    "look": 0.7,
}
_UPPER = tuple(_RANDOM_SHARE)[2:]
_ARM = {"raise": (14, 112), "swing": (-40, 100), "roll_in": (-30, 45), "elbow": (4, 120)}
_LEG = {"hip": (-10, 55), "spread": (0, 25), "turn_out": (-15, 25), "knee": (4, 60)}


def _random_upper(clock: Clock) -> Angles:
    angles = {}
    for name in _UPPER:
        low, high = (_RANDOM_SHARE[name] * limit for limit in LIMITS[name])
        angles[name] = clock.between(low, high, seconds=1.0)
    for side in SIDES:
        for name, (low, high) in _ARM.items():
            angles[f"{side}_{name}"] = clock.between(low, high, seconds=0.9)
    return angles


def random(clock: Clock) -> Angles:
    """Smooth random poses of the whole body inside the joint limits."""
    angles = _random_upper(clock)
    for name in ("pitch", "roll"):
        low, high = (_RANDOM_SHARE[name] * limit for limit in LIMITS[name])
        angles[name] = clock.between(low, high, seconds=1.3)
    for side in SIDES:
        for name, (low, high) in _LEG.items():
            angles[f"{side}_{name}"] = clock.between(low, high, seconds=1.2)
    angles["yaw"] = np.cumsum(clock.wander(70, seconds=1.5)) / clock.rate
    return angles


def mixed(clock: Clock) -> Angles:
    """The legs of another kind of motion under random poses of the upper body."""
    base = (walk, run, squat, turn, _idle)[clock.random.integers(5)](clock)
    upper = _random_upper(clock)
    fraction = clock.between(0.3, 1.0, seconds=2.0)
    for name, values in upper.items():
        start = base.get(name, np.full_like(fraction, NEUTRAL[name]))
        base[name] = start + fraction * (values - start)
    return base


KINDS: Mapping[str, Callable[[Clock], Angles]] = {
    kind.__name__: kind
    for kind in (
        walk,
        run,
        squat,
        jump,
        bend,
        lean,
        twist,
        reach,
        punch,
        kick,
        lunge,
        dash,
        turn,
        random,
        mixed,
    )
}
