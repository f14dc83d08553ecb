"""The second program: decides every claim of a certificate again; imports nothing of the package."""
