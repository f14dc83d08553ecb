"""Arc-wise dissipation: V = sum d_i e_i^2, whose decrease is split into terms of two variables, one
for each arc."""
