"""Searching for starts that contradict what is asked or certified.  Proposals; a proof comes from
``verify`` only."""
