"""The noise that everything is measured against."""
