"""Designs on request, each proved: observer gain, pinned agents and gains, both together."""
