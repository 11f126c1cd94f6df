"""What a reader can check: the residual per domain against the noise, and the gain on held-out samples."""
