"""The linear model that is held against the data: its responses, and its numbers that may be re-tuned."""
