"""Boxes that move with time, the certificates that take over, and settling times."""
