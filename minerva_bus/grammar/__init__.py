"""Table 1: symbols, strings, their text and their vocabulary."""
