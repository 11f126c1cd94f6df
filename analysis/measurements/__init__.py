"""One measurement per file: arrays in, a small frozen result out. `arrays` holds what all ask of their input."""
