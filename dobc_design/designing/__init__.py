"""Whole designs: W, pins and gains together, and what one limit costs in terms of another."""
