"""A run in the browser while it is recorded: what its page shows, and the server that shows it on this machine."""
