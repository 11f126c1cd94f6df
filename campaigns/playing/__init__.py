"""Plans and whole campaigns played on a bench: signals heard, logged or kept in memory, resumable after anything."""
