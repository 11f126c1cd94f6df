"""A hypothesis fitted in full simulation: descent, unknown starts, and what a form may be wrong by."""
