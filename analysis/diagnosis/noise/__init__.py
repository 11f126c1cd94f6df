"""The noise that everything is measured against: its colour, its level in bands, and the filter that takes both out."""
