"""Control design: one strategy element per file, pure functions from models to coefficients and arrays."""
