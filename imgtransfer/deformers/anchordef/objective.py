"""AnchorDEF's objective (equation 15) on batches of pieces of clips, with its schedule (supplement A)."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from imgtransfer.deformers.anchordef import losses
from imgtransfer.deformers.anchordef.anchors import nearest
from imgtransfer.deformers.anchordef.config import AnchorDefConfig
from imgtransfer.deformers.anchordef.network import AnchorNetwork, Outputs, anchor_transformations, deformed
from imgtransfer.deformers.anchordef.training_frames import SimplifiedFrames, TrainingFrames
from imgtransfer.deformers.common.laplacian import graph_laplacian
from imgtransfer.deformers.common.windows import Windows
from render.mesh.normals import VertexNormals, safe_normalize


class Objective:
    """The loss of each step.

    Args:
        network: whose parameters are fitted.
        frames: all there are. folds: simplified meshes; None leaves equation 12 out.
        seed: the batches follow from it and the step.
    """

    def __init__(
        self,
        config: AnchorDefConfig,
        network: AnchorNetwork,
        frames: TrainingFrames,
        folds: SimplifiedFrames | None,
        seed: int,
    ) -> None:
        self._config, self._network, self._frames, self._folds = config, network, frames, folds
        self._seed = seed
        n_vertices = frames.templates.shape[1]
        faces = frames.faces.cpu().numpy()
        self._laplacian = graph_laplacian(faces, n_vertices)
        self._normals = VertexNormals(faces, n_vertices)
        self._template_normals = self._normals(frames.templates)
        self._windows = Windows(frames.lengths, warm_up=0, length=config.frames)
        self._late = round(config.late_terms_at * config.steps)

    def learning_rate(self, step: int) -> float:
        """A tenth of the first one after `lower_rate_at` of the steps."""
        config = self._config
        return config.learning_rate * (1.0 if step < config.lower_rate_at * config.steps else 0.1)

    def __call__(self, step: int) -> dict[str, Tensor]:
        """The weighted terms of equation 15 at a step."""
        if step == self._late:
            self._renew_nearest()
        batch = self._windows.draw(self._config.sequences, np.random.default_rng((self._seed, step)))
        index, counted = batch.frames.to(self._frames.clip.device), batch.counted
        outputs = self._network(self._frames.features[index])
        outputs = Outputs(outputs.angles[counted], outputs.shifts[counted], outputs.displacements[counted])
        return self._terms(index[counted], outputs, late=step >= self._late) | self._anchor_term()

    def _terms(self, index: Tensor, outputs: Outputs, *, late: bool) -> dict[str, Tensor]:
        config, frames = self._config, self._frames
        clip, truth = frames.clip[index], frames.garment[index]
        attention = self._network.attention()
        anchors = (attention @ frames.templates)[clip]
        rotation, translation = anchor_transformations(
            outputs, anchors, self._network.tight, frames.rotation[index], frames.translation[index]
        )
        canonical = frames.templates[clip] + outputs.displacements
        vertices = deformed(canonical, self._network.blend_weights(), rotation, translation)
        moved = (rotation @ anchors[..., None])[..., 0] + translation
        rest_normals = safe_normalize(attention @ self._template_normals)[clip]
        normals = (rotation @ rest_normals[..., None])[..., 0]
        targets = attention @ truth
        target_normals = safe_normalize(attention @ self._normals(truth))
        terms = {
            "reconstruction": losses.squared_distance(vertices, truth),
            "laplacian": config.laplacian * losses.laplacian_loss(vertices, truth, self._laplacian),
            "consistency": config.consistency
            * losses.consistency_loss(moved, normals, targets, target_normals, config.normal),
        }
        if late:
            terms["collision"] = config.collision * losses.collision_loss(
                vertices, frames.body_points[index], frames.body_normals[index], config.collision_margin_m
            )
            terms["direction"] = config.direction * losses.direction_loss(moved, targets, target_normals)
        return terms

    def _anchor_term(self) -> dict[str, Tensor]:
        """Equation 12 on the frames that are simplified, the anchors moved there by equation 13."""
        if self._folds is None:
            return {}
        anchors = self._network.attention() @ self._folds.garment
        loss = losses.chamfer_loss(anchors, self._folds.vertices, self._folds.valid)
        return {"chamfer": self._config.chamfer * loss}

    def _renew_nearest(self) -> None:
        """Each vertex's nearest anchors where these are now (supplement A)."""
        network, template = self._network, self._frames.templates[0]
        with torch.no_grad():
            anchors = (network.attention() @ template).cpu().numpy()
        near = nearest(template.cpu().numpy(), anchors, network.anchors_near.shape[1])
        network.anchors_near.copy_(torch.from_numpy(near))
