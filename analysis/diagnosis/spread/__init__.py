"""Causes that show only in the spread of the residual: its lattice, its size or its colour; and lines beside bands."""
