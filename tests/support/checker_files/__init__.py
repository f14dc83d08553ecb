"""Certificates and problems for the second checker: good ones, and twins wrong in one place."""
