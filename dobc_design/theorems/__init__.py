"""Lemma 1, Theorem 1 and Theorem 2, each stated once, as exact affine matrix inequalities."""
