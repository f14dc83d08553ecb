"""Theorems 1 and 2 with V = e'De, D > 0 diagonal: the local question at the true rate."""
