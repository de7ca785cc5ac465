"""What a stage minimises: weights made for centimetres, terms in metres."""

import pytest
import torch

from fusion import FusionConfig
from fusion.stages import SolverResult, edge_weights, normal_weights, total

CONFIG = FusionConfig(weight_displacement=3.0, weight_edge=5.0, weight_consistency=7.0, weight_collision=11.0)


def test_weights_by_hand():
    """Terms in m² count 10,000 times as much as in cm², those in m a hundred times; normals have no unit."""
    assert edge_weights(CONFIG) == {"edge_length_m2": 1e4, "displacement_m2": 3e4}
    assert normal_weights(CONFIG) == {
        "normal_rendering": 1.0,
        "normal_consistency": 7.0,
        "edge_length_m2": 5e4,
        "displacement_m2": 3e4,
        "collision_m": 1100.0,
    }


def test_a_total_in_metres_is_that_of_the_paper_in_centimetres():
    """An edge 2 cm too long and a depth of 3 cm, weighted by hand in centimetres."""
    terms = {"edge_length_m2": torch.tensor([0.02**2]), "collision_m": torch.tensor([0.03])}
    torch.testing.assert_close(total(terms, normal_weights(CONFIG)), torch.tensor([5.0 * 4 + 11 * 3]))


def test_a_total_is_of_the_terms_that_there_are_frame_by_frame():
    terms = {"normal_rendering": torch.tensor([[1.0, 2.0]]), "normal_consistency": torch.tensor([[0.5, 0.0]])}
    assert total(terms, normal_weights(CONFIG)).tolist() == [[4.5, 2.0]]
    with pytest.raises(KeyError, match="collision_m"):
        total({"collision_m": torch.zeros(1)}, edge_weights(CONFIG))


def test_terms_are_asked_for_by_step():
    history = {"a": torch.tensor([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), "b": torch.zeros(3, 2)}
    result = SolverResult(torch.zeros(2, 1, 3), history, torch.tensor([2, 2]))
    assert result.at(1)["a"].tolist() == [3, 4]
    assert result.at(-1)["a"].tolist() == [5, 6]
    assert set(result.at(0)) == {"a", "b"}
