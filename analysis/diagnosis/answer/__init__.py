"""The answer in words and files: the sentence, `diagnosis.json`, the extended model and what it changed, the page."""
