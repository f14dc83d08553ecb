"""Diagnostics in floating point: observability, spectra and graph facts.  They explain; they never
prove."""
