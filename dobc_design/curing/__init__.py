"""Cures: proposed by design, decided by verify, before anyone sees them."""
