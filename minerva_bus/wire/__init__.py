"""PROTOCOL.md in code: keys, limits, and every message from bytes and to bytes."""
