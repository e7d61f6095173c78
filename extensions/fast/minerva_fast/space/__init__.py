"""Spaces: lattices, fields and graphs with compiled rules; see `Space` and `rule`."""
