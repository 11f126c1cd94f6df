"""Studies: the same test many times, over drawn and swept models, strategies and settings."""
