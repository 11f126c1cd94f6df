"""The physics of the bench, written once; imports nothing of the other packages."""
