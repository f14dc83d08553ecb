"""The linearisation at the target of a small network, decided whole."""
