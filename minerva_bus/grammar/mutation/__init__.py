"""Mutations of strings (the paper's section 5): from L(M) into L(M), a random stream at hand."""
