"""The linear model that is compared with the data: its responses, and its numbers that may be adjusted."""
