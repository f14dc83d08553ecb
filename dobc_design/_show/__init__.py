"""How nouns and results show themselves: cards, formulas, text."""
