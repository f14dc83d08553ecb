"""Small networks, box by box around a quadratic certificate."""
