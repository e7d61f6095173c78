"""Models for AMBER, with its columns."""
