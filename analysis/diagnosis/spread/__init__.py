"""Causes without a signature: they show in the lattice, the size or the colour of the residual."""
