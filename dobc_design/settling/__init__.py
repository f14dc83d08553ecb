"""A certified settling time: proposals joined, for ``verify`` to decide."""
