"""W, pins and gains together."""
