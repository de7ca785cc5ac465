"""AnchorDEF (Zhao et al., Learning Anchor Transformations for 3D Garment Animation, CVPR 2023): garments on anchors."""
