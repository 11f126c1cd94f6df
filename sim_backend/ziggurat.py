"""Tables of numpy's ziggurat method for normal numbers, as numba holds them; imported by what draws them alone."""

import numpy as np
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

signed_widths = np.concatenate([wi_double, -wi_double])
"""Widths of the 256 boxes per unit of a number's bits, then their negatives, whose products differ in the sign bit."""

__all__ = ["fi_double", "ki_double", "signed_widths", "ziggurat_nor_inv_r", "ziggurat_nor_r"]
