"""The objective of JointNet (section 3.4)."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from imgtransfer.deformers.jointnet.config import JointNetConfig
from render.mesh.normals import VertexNormals


class ClothLoss:
    """L = L_cloth + λ_norm L_norm + λ_s L_sparse (equation 6).

    Args:
        faces: (F, 3). vertices: N.
    """

    def __init__(self, faces: np.ndarray, vertices: int, config: JointNetConfig) -> None:
        self._normals = VertexNormals(np.asarray(faces), vertices)
        self._config = config

    def __call__(self, got: Tensor, wanted: Tensor, active: Tensor) -> dict[str, Tensor]:
        """The weighted terms, scalars.

        Args:
            got, wanted: G_T and G_T*, (F, N, 3), metres.
            active: φ(A), (V, J), none below 0.

        Returns:
            cloth_cm: mean over vertices of |x - x*|_1 (equation 7), cm. normals: the same of unit normals. sparse: the
            sum of φ(A) (equation 8).
        """
        terms = {"cloth_cm": 100 * (got - wanted).abs().sum(-1).mean()}
        if self._config.normal_weight:
            turned = self._normals(got) - self._normals(wanted.contiguous())
            terms["normals"] = self._config.normal_weight * turned.abs().sum(-1).mean()
        if self._config.sparse_weight:
            terms["sparse"] = self._config.sparse_weight * active.sum()
        return terms
