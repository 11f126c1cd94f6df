"""From recorded data to a linear model, with the standard deviation of every number."""
