"""PROTOCOL.md in Python: keys, limits, and the encoding and decoding of every message."""
