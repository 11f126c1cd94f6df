"""The effects of the library as candidates: how each looks in the outputs, and its numbers on even scales."""
