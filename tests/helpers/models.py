"""Models that no training has made."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from imgtransfer.data.clip import Clip
from imgtransfer.network import MapsConfig, NetworkConfig, TransferModel
from imgtransfer.network.local_transfer import LocalTransferNet
from render import Mesh, PositionBox

NETWORK = {
    "encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2},
    "blocks": 1,
    "target": "residual",
    "frame": "body",
    "shortcuts": True,
}


LOCAL = {
    "encoder": {"patch": 8, "dim": 16, "depth": 1, "heads": 2},
    "blocks": 1,
    "heads": 2,
    "target": "residual",
    "frame": "body",
    "body": "local",
    "history_s": [0.05],
}


def model_for(clip: Clip, network: Mapping[str, object] = NETWORK) -> TransferModel:
    """An untrained model whose outputs are not 0."""
    torch.manual_seed(0)
    model = TransferModel(
        maps=MapsConfig(size=(64, 48)),
        network=NetworkConfig.model_validate(network),
        template=Mesh(clip.template.vertices, clip.template.faces),
        box=PositionBox.around(clip.template.vertices, margin=0.5),
    )
    for net in (model.position_net, model.normal_net):
        last = net.to_patch if isinstance(net, LocalTransferNet) else net.decoder.to_image
        torch.nn.init.normal_(last.weight, std=0.1)
    return model.eval()


def local_model_for(clip: Clip) -> TransferModel:
    """The same, shown the body around each patch."""
    return model_for(clip, LOCAL)
