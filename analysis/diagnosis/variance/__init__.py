"""Variance effects: causes that show in the lattice, the size or the colour of the residual, and lines beside bands."""
