"""The paper's tables and figures beside ours: its numbers, one function per table and per figure, and the evidence."""
