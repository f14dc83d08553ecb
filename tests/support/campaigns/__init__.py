"""Counts over many random problems: fast tests call these with few seeds, evidence with many."""
