"""Equilibria other than the target."""
