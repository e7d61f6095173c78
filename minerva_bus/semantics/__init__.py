"""What strings of primitives and transformations mean in a geometric system (3.1.1)."""
