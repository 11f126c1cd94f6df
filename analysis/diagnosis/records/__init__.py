"""What was measured: logs read into records, cut into windows, some of them kept from every fit."""
