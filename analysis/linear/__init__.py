"""Linear models: simulated, brought to one form, and exchanged with other packages."""
