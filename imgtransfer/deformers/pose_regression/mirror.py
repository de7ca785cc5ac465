"""Mirror images of poses and of what skinning lacks, where skeleton and garment are alike on the left and the right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from imgtransfer.data.clip import Clip
from render.mesh.mesh import edges_of

_NEAR_M = 0.03  # how far a joint may lie from its partner's mirror image
_NEIGHBOURS = 3  # vertices that a mirrored place takes its value from
_SIGN = np.array([-1.0, 1, 1])  # of a vector
_TURN_SIGN = np.outer(_SIGN, _SIGN).ravel()  # of M R M, M = diag(-1, 1, 1), row by row


@dataclass(frozen=True, eq=False)
class Mirror:
    """The mirror in the plane through the root joint at rest whose normal is x.

    Args:
        partners: (J,) int, each joint's on the other side; its own number in the middle.
        vertices: (N, 3) int, those that are nearest to the mirror image of each vertex at rest.
        weights: (N, 3) float64, of these; rows sum to 1.
    """

    partners: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, clip: Clip) -> Mirror | None:
        """The mirror of a clip's skeleton and garment; None where one of them is not its own mirror image."""
        joints, parents, poses = clip.skeleton.joints_rest, clip.skeleton.parents, clip.skeleton.poses
        if joints is None or parents is None or poses is None or poses.shape[1] != len(joints):
            return None
        centre = float(joints[0, 0])
        distance, partners = cKDTree(joints).query(_reflected(joints, centre))
        whole = (partners[partners] == np.arange(len(joints))).all()
        inner = parents >= 0
        if not (
            whole
            and distance.max() < _NEAR_M
            and (partners[parents[inner]] == parents[partners[inner]]).all()
        ):
            return None
        rest, edges = clip.template.vertices.astype(np.float64), edges_of(clip.template.faces)
        count = min(_NEIGHBOURS, len(rest))
        away, nearest = (
            values.reshape(len(rest), count)
            for values in cKDTree(rest).query(_reflected(rest, centre), k=count)
        )
        if away[:, 0].mean() > np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1).mean():
            return None
        closeness = 1 / np.maximum(away, 1e-9)
        return cls(partners, nearest, closeness / closeness.sum(axis=1, keepdims=True))

    def features(self, features: np.ndarray) -> np.ndarray:
        """(T, J, 2, 9) as `pose_features` gives them, of the mirrored body."""
        mirrored = features[:, self.partners] * _TURN_SIGN
        mirrored[:, 0, :, :3] = features[:, 0, :, :3] * _SIGN  # the vertical in the root's axes
        return mirrored

    def residuals(self, residuals: np.ndarray) -> np.ndarray:
        """(T, 3 N) in the garment's axes at rest, of the mirrored garment; in their type."""
        own = residuals.reshape(len(residuals), -1, 3)
        mirrored = np.zeros_like(own)
        for corner in range(self.vertices.shape[1]):
            mirrored += own[:, self.vertices[:, corner]] * self.weights[:, corner, None].astype(own.dtype)
        return (mirrored * _SIGN.astype(own.dtype)).reshape(len(own), -1)


def _reflected(points: np.ndarray, centre: float) -> np.ndarray:
    return np.asarray(points, np.float64) * _SIGN + (2 * centre, 0, 0)
