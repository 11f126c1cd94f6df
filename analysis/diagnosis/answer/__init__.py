"""The answer as files: `diagnosis.json`, the extended model, the page and its figures."""
