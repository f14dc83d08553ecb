"""Graphs that no list of modes holds, because they move, or that a Markov chain draws."""
