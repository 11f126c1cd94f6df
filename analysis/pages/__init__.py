"""What all pages and figures are made of: the canvas, numbers as people read them, interactive plots, style."""
