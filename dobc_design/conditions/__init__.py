"""Everything that can be proved or refuted: one room for each topic."""
