import numpy as np
import pytest
import torch

from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.common.recurrent import MotionGru, Standardise
from imgtransfer.deformers.common.rotations import rotation_matrices
from imgtransfer.deformers.virtual_bones.bone_motion import BoneMotion, bone_spread
from imgtransfer.deformers.virtual_bones.displacements import EdgeConvolution, neighbours_of


def test_standardise_by_hand():
    features = torch.tensor([[0.0, 5.0], [2.0, 5.0]])
    got = Standardise(features)(torch.tensor([[3.0, 7.0], [99.0, 5.0]]))
    assert got.tolist() == [[2, 0], [5, 0]]  # the second never varied; five deviations are the most


def test_a_whole_clip_in_the_gru_is_its_frames_one_by_one_and_a_batch_its_singles():
    torch.manual_seed(0)
    memory = MotionGru(torch.randn(50, 4), 6, 0.5).eval()
    clips = torch.randn(3, 9, 4)
    together = memory(clips)
    for clip, want in zip(clips, together, strict=True):
        torch.testing.assert_close(memory.whole(clip, 0), want)
    padded = torch.cat([clips[0, :1], clips[0, :1], clips[0]])
    torch.testing.assert_close(memory.whole(clips[0], 2), memory(padded[None])[0, 2:])


def test_neighbours_of_a_fan():
    edges = np.array([[0, 1], [0, 2], [1, 2], [2, 3]])
    assert neighbours_of(edges, 5).tolist() == [[1, 2, 2], [0, 2, 2], [0, 1, 3], [2, 2, 2], [4, 4, 4]]


def test_edge_convolution_is_the_greatest_over_edges_in_a_plain_loop():
    torch.manual_seed(1)
    layer = EdgeConvolution(3, 5)
    neighbours = neighbours_of(np.array([[0, 1], [0, 2], [1, 2], [2, 3]]), 4)
    values = torch.randn(2, 4, 3)
    got = layer(values, neighbours)
    own, other = layer.own.weight, layer.other.weight
    for frame in range(2):
        for i in range(4):
            x = values[frame, i]
            # W (x_i, x_j - x_i) = U x_i + V (x_j - x_i)
            edges = [own @ x + layer.own.bias + other @ (values[frame, j] - x) for j in neighbours[i]]
            want = torch.nn.functional.leaky_relu(torch.stack(edges), 0.2).amax(0)
            torch.testing.assert_close(got[frame, i], want)


def bones(dropout: float = 0.0) -> tuple[BoneMotion, torch.Tensor]:
    template = torch.tensor([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 5, 0]])
    weights = torch.tensor([[1.0, 0], [1, 0], [1, 0], [0, 1]])
    skinning = BoneSkinning(weights)
    return BoneMotion(torch.randn(9, 4), skinning, template, hidden=6, dropout=dropout), template


def test_the_spread_of_bones_by_hand():
    _, template = bones()
    mass, spread = bone_spread(BoneSkinning(torch.tensor([[1.0, 0], [1, 0], [1, 0], [0, 1]])), template)
    assert mass.tolist() == [0.75, 0.25]
    torch.testing.assert_close(spread[0], torch.tensor([[8 / 9, -2 / 9, 0], [-2 / 9, 2 / 9, 0], [0, 0, 0]]))
    assert spread[1].abs().max() == 0  # of a single vertex


def test_the_loss_of_bones_is_the_squared_distance_of_their_vertices():
    low, template = bones()
    numbers = torch.randn(5, 2, 6) * 0.3
    turn = rotation_matrices(torch.randn(5, 2, 3))
    offset = torch.randn(5, 2, 3)
    places = low.skinning.places(template)
    got = low.skinning(*low.skinning.bones(numbers), places, template)
    want = low.skinning(turn, offset, places, template)
    distance = (got - want).square().sum(-1).mean()
    assert low.loss(numbers, turn, offset).item() == pytest.approx(1e4 * distance.item(), rel=1e-5)
