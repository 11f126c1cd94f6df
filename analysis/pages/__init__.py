"""What all pages, figures and sentences are made of: the canvas, numbers as people read them, plots, style."""
