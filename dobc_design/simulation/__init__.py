"""Trajectories of the closed loop in floating point.  They illustrate; a trajectory never proves or
refutes."""
