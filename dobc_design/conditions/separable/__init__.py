"""The max-separable certificate of a box of starts, with delays and sampling (theory, section
5)."""
