"""Motion guided deep dynamic 3D garments (Zhang et al., ACM Transactions on Graphics 2022): a garment's next frame from
its last ones, through a space of garments that is learned first.
"""
