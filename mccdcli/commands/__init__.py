"""The commands, one per file.

To add one, write a click command here and its line in `mccdcli.registry`. At the top of the file import only
what is light (click, `mccdcli`, `sim_backend.errors`); everything else inside the function. The first line of the
docstring is the registry's line; a paragraph "Examples:" follows. Return the exit code, or None for success.
"""
