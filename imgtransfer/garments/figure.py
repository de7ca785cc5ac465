"""What garments need to know of a body: its surface at rest, its arms and legs, and the heights that tailors use."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.bodies.skinned import SkinnedBody
from imgtransfer.bodies.smpl import INDEX
from imgtransfer.garments.limbs import ARM_RADIUS, along_chain, on_arms
from render import InputError

_SIDES = ("left", "right")
_HAND = 0.2  # metres from the wrist past the fingertips
_SLICE = 0.01  # metres, height of a section
_SAMPLES = 5  # subdivisions of a body face's edge when sections are measured
ANGLES = np.linspace(0, 2 * np.pi, 64, endpoint=False)


@dataclass(frozen=True, eq=False)
class Figure:
    """A body at rest, metres, y up, facing +z, in an A- or T-pose.

    Args:
        vertices: (B, 3) float64. faces: (G, 3) int, closed, counter-clockwise seen from outside.
        joints: (22, 3) float64, the SMPL joints.
    """

    vertices: np.ndarray
    faces: np.ndarray
    joints: np.ndarray

    @classmethod
    def of(cls, body: SkinnedBody) -> Figure:
        """The figure of a body."""
        return cls(body.rest.astype(np.float64), body.faces, body.joints_rest)

    def joint(self, name: str) -> np.ndarray:
        """(3,) a joint by its name in SMPL."""
        return self.joints[INDEX[name]]

    def leg_height(self, fraction: float) -> float:
        """Height at a fraction of the distance from the hip joints (0) to the ankles (1), metres."""
        hip, ankle = (
            np.mean([self.joint(f"{side}_{name}")[1] for side in _SIDES]) for name in ("hip", "ankle")
        )
        return float(hip + fraction * (ankle - hip))

    def arm(self, side: str) -> np.ndarray:
        """(4, 3) shoulder, elbow, wrist and a point past the fingertips."""
        shoulder, elbow, wrist = (self.joint(f"{side}_{name}") for name in ("shoulder", "elbow", "wrist"))
        along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        return np.stack([shoulder, elbow, wrist, wrist + _HAND * along])

    def sleeve_end(self, side: str, fraction: float) -> tuple[np.ndarray, np.ndarray]:
        """(3,) the point at a fraction of the arm, shoulder (0) to wrist (1), and the arm's unit direction there."""
        arm = self.arm(side)
        lengths = np.linalg.norm(np.diff(arm[:3], axis=0), axis=1)
        rest = fraction * lengths.sum()
        segment = int(rest > lengths[0])
        along = (arm[segment + 1] - arm[segment]) / lengths[segment]
        return arm[segment] + (rest - segment * lengths[0]) * along, along

    def shortened_arms(self, fraction: float) -> np.ndarray:
        """(B, 3) vertices with the arms flattened onto their section at a fraction of the arm, shoulder to wrist.

        The surface stays closed, and what hangs beside the hips is gone.
        """
        vertices = self.vertices.copy()
        for side in _SIDES:
            end, along = self.sleeve_end(side, fraction)
            arm = self.arm(side)
            lengths = np.linalg.norm(np.diff(arm, axis=0), axis=1)
            position, offset, _ = along_chain(arm, self.vertices)
            beyond = self._on_arm & (np.sign(vertices[:, 0] - self.joint("pelvis")[0]) == np.sign(along[0]))
            beyond &= position > fraction * lengths[:2].sum()
            flat = offset[beyond] - (offset[beyond] @ along)[:, None] * along
            wide = np.linalg.norm(flat, axis=1, keepdims=True)
            vertices[beyond] = end + flat * np.minimum(1, ARM_RADIUS / np.maximum(wide, 1e-9))
        return vertices

    @cached_property
    def _on_arm(self) -> np.ndarray:
        """(B,) bool, vertices nearer to an arm than to trunk, head or legs."""
        return on_arms(self.vertices, self.joints, [self.arm(side) for side in _SIDES])

    def nearer_to_arm(self, points: np.ndarray, side: str) -> np.ndarray:
        """(N,) distance of points (N, 3) to the skin of trunk, head and legs less that to an arm's, metres."""
        this_side = (self.vertices[:, 0] > self.axis[0]) == (self.arm(side)[2, 0] > self.axis[0])
        arm, rest = cKDTree(self.vertices[self._on_arm & this_side]), cKDTree(self.vertices[~self._on_arm])
        return rest.query(points)[0] - arm.query(points)[0]

    @cached_property
    def _trunk_points(self) -> np.ndarray:
        """(M, 3) points spread over the surface without the arms."""
        faces = self.faces[~self._on_arm[self.faces].all(axis=1)]
        steps = np.array([(i, j) for i in range(_SAMPLES + 1) for j in range(_SAMPLES + 1 - i)]) / _SAMPLES
        weights = np.concatenate([steps, 1 - steps.sum(axis=1, keepdims=True)], axis=1)
        return np.einsum("sc,fcx->fsx", weights, self.vertices[faces]).reshape(-1, 3)

    @cached_property
    def axis(self) -> np.ndarray:
        """(3,) a point on the vertical line about which sections are measured."""
        return self.joint("pelvis")

    def supports(self, heights: np.ndarray) -> np.ndarray:
        """Convex hulls of the trunk's and legs' horizontal sections.

        Args:
            heights: (K,) metres.

        Returns:
            (K, 64) distance of the hull's tangent from `axis` in each direction of `ANGLES` (cosine towards +x, sine
            towards +z); nan where there is no body.
        """
        points = self._trunk_points - self.axis
        reach = points[:, [0, 2]] @ np.stack([np.cos(ANGLES), np.sin(ANGLES)])
        low = heights.min() - _SLICE
        level = np.floor((self._trunk_points[:, 1] - low) / _SLICE).astype(int)
        count = int(np.ceil((heights.max() - low) / _SLICE)) + 1
        inside = (level >= 0) & (level < count)
        hulls = np.full((count, len(ANGLES)), -np.inf)
        np.maximum.at(hulls, level[inside], reach[inside])
        hulls[np.isinf(hulls)] = np.nan
        nearest = np.floor((heights - low) / _SLICE).astype(int)
        return hulls[nearest]

    @cached_property
    def crotch(self) -> float:
        """Height at which the legs part, metres: of the lowest skin between them that looks down."""
        corners = self.vertices[self.faces]
        centres = corners.mean(axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        between = (np.abs(centres[:, 0] - self.axis[0]) < 0.03) & (normals[:, 1] < -0.6)
        between &= (centres[:, 1] > self.leg_height(0.5)) & (centres[:, 1] < self.leg_height(-0.1))
        if not between.any():
            raise InputError(
                "the body has no skin that looks down between its legs; a closed body mesh, y up, with parted legs "
                "is wanted"
            )
        return float(centres[between, 1].min())

    @cached_property
    def waist(self) -> float:
        """Height of the narrowest section between hips and ribs, metres."""
        hip, chest = self.leg_height(0.0), self.joint("left_shoulder")[1]
        heights = np.linspace(hip + 0.28 * (chest - hip), hip + 0.62 * (chest - hip), 30)
        return float(heights[np.nanargmin(self.supports(heights).mean(axis=1))])

    @cached_property
    def neck(self) -> tuple[np.ndarray, float]:
        """(3,) centre of its base, a third wider than the narrowest section, and the half width of that section."""
        shoulder, head = self.joint("left_shoulder")[1], self.joint("head")[1]
        heights = np.arange(shoulder, head + 0.06, _SLICE)
        hulls = self.supports(heights)
        width = (hulls[:, 0] + hulls[:, len(ANGLES) // 2]) / 2  # half the extent along x
        narrowest = int(np.nanargmin(width))
        wide = np.flatnonzero(width[:narrowest] > 1.33 * width[narrowest])
        base = int(wide.max()) if len(wide) else 0
        front, back = hulls[base, len(ANGLES) // 4], hulls[base, 3 * len(ANGLES) // 4]
        centre = np.array([self.axis[0], heights[base], self.axis[2] + (front - back) / 2])
        return centre, float(width[narrowest])
