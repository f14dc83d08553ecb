"""Vectors and matrices of exact numbers, written as text: ``matrix("1 0; 0 1/2")``."""


def vector(text: str) -> list[str]:
    """The numbers between blanks."""
    return text.split()


def matrix(text: str) -> list[list[str]]:
    """One row between semicolons."""
    return [vector(row) for row in text.split(";")]
