"""A garment of two layers of cloth: the tube of `fusion_examples` with a copy of a part of it inside or outside."""

import numpy as np
import torch

from render import Mesh, vertex_normals
from tests.helpers.fusion_examples import AROUND, tube

TUBE = tube()


def layered(offset, flip=False, rows=slice(3, 14), columns=slice(None)):
    """The tube with a copy of some of its rows and columns, `offset` metres outside; and which vertices are copies."""
    number = np.arange(len(TUBE.vertices)).reshape(-1, AROUND)[rows, columns].ravel()
    place = np.full(len(TUBE.vertices), -1)
    place[number] = len(TUBE.vertices) + np.arange(len(number))
    faces = place[TUBE.faces]
    faces = faces[(faces >= 0).all(1)]
    radial = TUBE.vertices * [1, 0, 1] / 0.15
    vertices = np.concatenate([TUBE.vertices, (TUBE.vertices + offset * radial)[number]])
    mesh = Mesh(vertices, np.concatenate([TUBE.faces, faces[:, ::-1] if flip else faces]))
    return mesh, np.arange(len(vertices)) >= len(TUBE.vertices)


def bent(points, curvature=2.5):
    """The tube's axis, along y, bent to an arc in the plane of y and z."""
    radius = 1 / curvature
    angle, depth = points[:, 1] * curvature, radius - points[:, 2]
    return np.stack([points[:, 0], depth * np.sin(angle), radius - depth * np.cos(angle)], axis=1)


def heights(vertices, outer, copies):
    """Metres of the copies above the tube, along its normals."""
    base = vertices[: len(TUBE.vertices)]
    normals = vertex_normals(torch.from_numpy(base), torch.from_numpy(TUBE.faces)).numpy()
    return ((vertices[copies] - base[outer]) * normals[outer]).sum(1)
