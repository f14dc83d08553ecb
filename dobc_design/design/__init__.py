"""Proposals: observer gains, pairs (P, Q), eigenvalue estimates.  Floating point; nothing here proves."""
