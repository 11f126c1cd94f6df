"""Variance effects: causes that show only in the quantisation, variance or colour of the residual; lines or bands."""
