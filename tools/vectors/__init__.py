"""The cases of the protocol's test vectors, and their notation."""
