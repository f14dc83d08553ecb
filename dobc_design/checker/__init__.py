"""The lone checker: decides every claim of a certificate again, and imports nothing of the package;
see __main__.py."""
