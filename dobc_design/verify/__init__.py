"""Deciding, exactly: every PROVED and every REFUTED of the toolbox is made here (floor 4, trusted)."""
