"""An effect, a plan, a strategy and an importer for mccd."""
