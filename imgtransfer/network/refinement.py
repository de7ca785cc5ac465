"""Pose-conditioned feature refinement: the garment's tokens look at the body's (section 3.2, equations 9 to 11)."""

from __future__ import annotations

from torch import Tensor, nn

from imgtransfer.network.attention import Attention, mlp


class RefinementBlock(nn.Module):
    """One of the K blocks: cross-attention to the body, self-attention, MLP.

    Args:
        dim: width of the tokens.
        heads: heads of both attentions (4 in the paper).
        dropout: see `NetworkConfig`.
        cross_modal: whether the garment's tokens also look at those of the other network (table 4).
    """

    def __init__(self, dim: int, heads: int, dropout: float = 0.0, *, cross_modal: bool = False) -> None:
        super().__init__()
        self.norm_cross = nn.LayerNorm(dim)
        self.cross = Attention(dim, heads, dropout)
        self.norm_self = nn.LayerNorm(dim)
        self.self_attention = Attention(dim, heads, dropout)
        self.norm_mlp = nn.LayerNorm(dim)
        self.mlp = mlp(dim, dropout)
        if cross_modal:
            self.norm_modal, self.norm_other = nn.LayerNorm(dim), nn.LayerNorm(dim)
            self.modal = Attention(dim, heads, dropout)

    def forward(
        self, garment: Tensor, body: Tensor, other: Tensor | None = None, *, seen: Tensor | None = None
    ) -> Tensor:
        """(B, M, dim) garment tokens, (B, M', dim) body tokens -> (B, M, dim) garment tokens.

        `other` (B, M, dim): the other network's garment tokens, which a block that is `cross_modal` needs.

        The body's tokens enter without a norm of this block, as in equation 9; the encoder ends with one. `seen`
        (1 or B, M) bool, with M' = M: which tokens show anything; all if None.
        """
        garment = garment + self.cross(self.norm_cross(garment), body, seen=seen)  # equation 9
        if other is not None:
            garment = garment + self.modal(self.norm_modal(garment), self.norm_other(other))
        normed = self.norm_self(garment)
        garment = garment + self.self_attention(normed, normed, seen=seen)  # equation 10
        return garment + self.mlp(self.norm_mlp(garment))  # equation 11
