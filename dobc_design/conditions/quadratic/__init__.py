"""Quadratic certificates of a region (Lur'e, theory, section 4)."""
