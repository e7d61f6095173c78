"""Studies: many runs of a world, to find its best string or to compare its options."""
