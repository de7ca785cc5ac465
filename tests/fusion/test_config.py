"""Hyper-parameters: the paper's by default, nothing unknown, nothing out of range."""

import pytest
from pydantic import ValidationError

from fusion import FusionConfig
from imgtransfer.config.loader import load_config
from render import InputError


def test_defaults_are_the_paper_s():
    config = FusionConfig()
    assert (config.learning_rate_m, config.edge_steps, config.normal_steps) == (1e-3, 100, 100)
    assert (config.weight_displacement, config.weight_edge, config.weight_collision) == (0.02, 100, 100)
    assert config.weight_consistency == 0.001
    assert config.on_skin(None).collision_margin_m == 0


def test_the_margin_is_what_is_known_of_the_cloth_unless_it_is_said():
    assert FusionConfig().on_skin(0.004).collision_margin_m == FusionConfig().on_skin(0.004).margin_m == 0.004
    assert FusionConfig(collision_margin_m=0.0).on_skin(0.004).collision_margin_m == 0
    assert FusionConfig(solver="adam").on_skin(0.004).collision_margin_m == 0  # the paper's
    assert FusionConfig(solver="adam", collision_margin_m=0.002).on_skin(0.004).collision_margin_m == 0.002
    assert FusionConfig(weight_edge=3).on_skin(0.004) == FusionConfig(weight_edge=3, collision_margin_m=0.004)
    assert FusionConfig().margin_m == 0


def test_it_is_frozen_and_every_field_is_described():
    with pytest.raises(ValidationError, match="frozen"):
        FusionConfig().edge_steps = 3
    assert all(field.description for field in FusionConfig.model_fields.values())


def test_a_file_holds_only_differences(tmp_path):
    path = tmp_path / "fusion.yaml"
    path.write_text("weight_consistency: 0.01\n")
    assert load_config(FusionConfig, path) == FusionConfig(weight_consistency=0.01)
    path.write_text("")
    assert load_config(FusionConfig, path) == FusionConfig()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wieght_edge: 3\n", "wieght_edge: no such setting, did you mean weight_edge"),
        ("learning_rate_m: 5\n", "learning_rate_m: a number above 0 .* is wanted, found 5"),
        ("weight_edge: .nan\n", "weight_edge: a number from 0 to 1e.09 is wanted, found nan"),
        ("- 1\n", "a mapping of settings is wanted, found a list"),
        ("a: [1\n", "not YAML"),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path, text, message):
    path = tmp_path / "fusion.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_config(FusionConfig, path)
    assert "\n" not in str(caught.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_config(FusionConfig, tmp_path / "none.yaml")
