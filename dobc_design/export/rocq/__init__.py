"""Proofs for the kernel of Rocq (Coq 8.16): of matrix inequalities, and of the motions of the
loop."""
