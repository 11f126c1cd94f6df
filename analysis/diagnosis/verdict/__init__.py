"""From a search to a verdict, held against everything that is no listed cause."""
