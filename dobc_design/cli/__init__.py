"""dobc: the command line."""
