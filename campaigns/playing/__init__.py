"""Plans and whole campaigns played on a bench: signals heard, everything logged, resumable after anything."""
