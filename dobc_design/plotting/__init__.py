"""Figures of runs: arrays in, Matplotlib figures or HTML out.  Nothing is computed here but what a
drawing needs."""
