"""Solvers of semidefinite programs.  They propose; nothing here proves."""
