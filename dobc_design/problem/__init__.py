"""The problem as the user states it: exact, validated, frozen (see ``problem``)."""
