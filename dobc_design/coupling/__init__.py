"""Coupling functions: the expression language, its functions, and enclosures of h."""
