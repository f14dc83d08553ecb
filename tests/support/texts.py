"""Vectors and matrices of exact numbers, written as text: ``matrix("1 0; 0 1/2")``."""

from dobc_design import Exosystem
from dobc_design.exact import matrix as exact


def vector(text: str) -> list[str]:
    """The numbers between blanks."""
    return text.split()


def matrix(text: str) -> list[list[str]]:
    """One row between semicolons."""
    return [vector(row) for row in text.split(";")]


def ranges(text: str, coupling: int = 0) -> list[dict[str, object]]:
    """The gains of a coupling in a claim: a matrix of intervals, commas between its columns."""
    gains = []
    for row in text.split(";"):
        gains.append([vector(interval) for interval in row.split(",")])
    return [{"coupling": coupling, "gains": gains}]


def exact_matrix(text: str) -> exact.Matrix:
    """A matrix of Fractions."""
    return exact.matrix(matrix(text))


def exosystem_of(A: str, C: str) -> Exosystem:
    """The exosystem xi' = A xi, d = C xi."""
    return Exosystem(A=matrix(A), C=matrix(C))
