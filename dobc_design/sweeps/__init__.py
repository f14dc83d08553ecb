"""Many problems at once: one problem with some keys varied, decided or simulated in parallel,
resumable."""
