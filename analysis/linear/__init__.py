"""Linear models simulated, and written as other packages have them."""
