"""What is told of networks' sizes before anybody makes them."""

from __future__ import annotations

import pytest

from imgtransfer.network import MapsConfig, NetworkConfig
from imgtransfer.network.memory import check_training_memory, least_weights
from imgtransfer.network.transfer import build_transfer_net

LOCAL = {"target": "residual", "frame": "body", "body": "local"}


@pytest.mark.parametrize(
    ("form", "size", "patch"),
    [
        ({}, 256, 4),
        ({}, 32, 16),
        ({"shortcuts": True}, 64, 8),
        (LOCAL, 256, 4),
        (LOCAL | {"history_s": [0.1, 0.2]}, 256, 4),
        (LOCAL, 32, 16),
    ],
)
@pytest.mark.parametrize("dim", [16, 64])
def test_no_network_has_fewer_weights_than_it_has_at_least(
    form: dict[str, object], size: int, patch: int, dim: int
) -> None:
    """Local networks with many small patches were said to have more than they have, and refused when they were read."""
    encoder = {"patch": patch, "dim": dim, "depth": 1, "heads": 2}
    network = NetworkConfig.model_validate(form | {"encoder": encoder, "blocks": 1, "heads": 2})
    maps = MapsConfig(size=(size, size))
    made = build_transfer_net(network, maps.size, views=2)
    assert sum(value.numel() for value in made.state_dict().values()) >= least_weights(network, maps) > 0


def test_averaged_weights_count(monkeypatch: pytest.MonkeyPatch) -> None:
    network, maps = NetworkConfig(), MapsConfig()
    asked: list[float] = []
    monkeypatch.setattr("imgtransfer.network.memory.check_memory", lambda count, _: asked.append(count))
    for averaged in (False, True):
        check_training_memory(network, maps, batch_frames=1, averaged=averaged)
    assert asked[1] - asked[0] == 2 * 4 * least_weights(network, maps)
