import numpy as np
import pytest
import torch

from imgtransfer.deformers.common.bone_skinning import BoneSkinning
from imgtransfer.deformers.jointnet.config import JointNetConfig
from imgtransfer.deformers.jointnet.joint_gru import JointGru, joint_inputs, neighbour_joints
from imgtransfer.deformers.jointnet.loss import ClothLoss
from imgtransfer.deformers.jointnet.network import BoneNetwork, Displacements, FourierFeatures

PARENTS = np.array([-1, 0, 0, 1, 3])
CONFIG = JointNetConfig(
    hidden=6, joint_features=4, bone_layers=(8,), shapes=3, shape_layers=(5,), dropout=0.0, sparse_weight=0.1
)


def test_each_joints_gru_is_pytorchs():
    torch.manual_seed(0)
    ours = JointGru(3, 4, 5)
    features = torch.randn(2, 7, 3, 4)
    got = ours(features)
    for joint in range(3):
        theirs = torch.nn.GRU(4, 5, batch_first=True)
        theirs.weight_ih_l0.data = ours.input_weight[joint].T
        theirs.weight_hh_l0.data = ours.hidden_weight[joint].T
        theirs.bias_ih_l0.data, theirs.bias_hh_l0.data = ours.input_bias[joint, 0], ours.hidden_bias[joint, 0]
        torch.testing.assert_close(got[:, :, joint], theirs(features[:, :, joint])[0])


def test_neighbours_on_the_skeleton_by_hand():
    assert neighbour_joints(PARENTS).tolist() == [[1, 2], [0, 3], [0, 2], [1, 4], [3, 4]]


def test_a_joints_inputs_are_the_root_itself_and_its_neighbours():
    root, joints = torch.arange(9.0), torch.arange(1.0, 5.0)[:, None].expand(4, 6)  # six times its number
    got = joint_inputs(root, joints, torch.from_numpy(neighbour_joints(PARENTS)))
    assert got.shape == (5, 27)
    assert got[3].tolist() == [*range(9), *[3] * 6, *[1] * 6, *[4] * 6]
    assert got[0].tolist() == [*range(9), *[0] * 6, *[1] * 6, *[2] * 6]


def test_fourier_features_by_hand():
    fourier = FourierFeatures(2, 1.0)
    fourier.frequencies.copy_(torch.tensor([[1.0, 0, 0], [0, 0.5, 0]]))
    fourier.coefficients.data = torch.tensor([2.0, 3.0])
    got = fourier(torch.tensor([[0.25, 1.0, 7.0]]))
    torch.testing.assert_close(got, torch.tensor([[0.0, 2, -3, 0]]), atol=1e-6, rtol=0)


def network() -> BoneNetwork:
    torch.manual_seed(2)
    weights = torch.eye(2).repeat_interleave(3, 0)
    neighbours = torch.from_numpy(neighbour_joints(PARENTS))
    inputs = joint_inputs(torch.randn(9, 9), torch.randn(9, 4, 6), neighbours)
    return BoneNetwork(inputs, neighbours, BoneSkinning(weights), torch.randn(6, 3), CONFIG)


def test_only_associated_joints_move_a_bone():
    net = network()
    net.association.data = torch.tensor([[1.0, 0, -3, 0, 0], [0, 0, 2, 1, 0]])
    features = torch.randn(1, 5, 4)
    before = net.numbers(features)
    features[:, 2] += 1.0  # joint 2 is associated with bone 1; its weight for bone 0 is below 0
    after = net.numbers(features)
    torch.testing.assert_close(after[:, 0], before[:, 0], rtol=0, atol=0)
    assert (after[:, 1] - before[:, 1]).abs().max() > 1e-3


def test_bones_are_told_apart_by_where_they_rest():
    net = network()
    net.association.data[1] = net.association.data[0]
    numbers = net.numbers(torch.randn(1, 5, 4))
    assert (numbers[:, 0] - numbers[:, 1]).abs().max() > 1e-3


def test_displacements_are_a_sum_over_joints_and_shapes():
    torch.manual_seed(3)
    psd = Displacements(5, 7, CONFIG)
    psd.shapes.data.normal_()
    features = torch.randn(2, 5, 4)
    blend = psd.blend(features)
    shapes = psd.shapes.view(5, 3, 7, 3)
    want = sum(blend[:, j, x, None, None] * shapes[j, x] for j in range(5) for x in range(3))
    torch.testing.assert_close(psd(features), 1e-3 * want)


def test_displacements_begin_at_nothing():
    assert Displacements(5, 7, CONFIG)(torch.randn(2, 5, 4)).abs().max() == 0


def test_the_losses_by_hand():
    triangle = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    loss = ClothLoss(np.array([[0, 1, 2]]), 3, CONFIG)
    turned = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 0, -1]]])  # its normal is y, not z
    terms = loss(turned, triangle, torch.tensor([[1.0, 0.5], [0, 2]]))
    assert terms["cloth_cm"].item() == pytest.approx(100 * 2 / 3)
    assert terms["normals"].item() == pytest.approx(0.5 * 2)
    assert terms["sparse"].item() == pytest.approx(0.1 * 3.5)
    same = loss(triangle, triangle, torch.zeros(2, 2))
    assert [term.item() for term in same.values()] == [0, 0, 0]
