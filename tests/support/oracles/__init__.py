"""Oracles for certificates, written from the page of the format and by other libraries.

They share no code with the package's theorems.
"""
