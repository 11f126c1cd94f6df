"""The second generator of blind cases: another simulator of other plants, sharing no law with what is fitted."""
