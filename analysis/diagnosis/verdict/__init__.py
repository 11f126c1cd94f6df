"""From a search to a verdict, after comparison with unlisted alternatives."""
