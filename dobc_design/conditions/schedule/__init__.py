"""Certificates that take over from each other, and settling times."""
