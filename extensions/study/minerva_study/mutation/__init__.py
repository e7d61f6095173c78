"""Mutations of strings (section 5): random functions from L(M) to L(M)."""
