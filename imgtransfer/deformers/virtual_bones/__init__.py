"""Virtual bones that a recurrent network moves, and displacements of vertices beside (Pan et al. 2022)."""
