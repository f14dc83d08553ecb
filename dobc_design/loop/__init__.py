"""What a proof is about: the loop that a problem describes (``loop_of``)."""
