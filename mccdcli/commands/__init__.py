"""The commands, one per file; `mccdcli.registry` lists them."""
