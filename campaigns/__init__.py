"""What is done on a bench, and what was recorded; no physics of its own."""
