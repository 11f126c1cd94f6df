"""One measurement per file: arrays in, a small frozen result out."""
