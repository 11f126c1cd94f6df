"""Arrays that a reader hands on piece by piece, put together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.pieces import Pieces


def whole(pieces: Pieces) -> NDArray[Any]:
    """Return the array; its pieces have as many numbers as its shape."""
    shaped = np.concatenate([piece.reshape(-1) for piece in pieces.read()]).reshape(pieces.shape)
    return shaped.T if pieces.turned else shaped
