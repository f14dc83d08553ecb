"""Pinned agents and gains on request."""
