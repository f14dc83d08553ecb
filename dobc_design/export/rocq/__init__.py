"""Proofs for the kernel of Rocq (Coq 8.16): of matrix inequalities, and of the motions of the
loop.

Optional: needs Coq where a file is checked, for motions with its libraries Coquelicot and Interval
(Debian: coq, libcoq-coquelicot, libcoq-interval); nothing where a file is written.
"""
