"""Lemma 1 and Theorems 1 and 2 at the consensus."""
