"""A hypothesis fitted in full simulation: descent, unknown starts, and the model discrepancy of an effect."""
