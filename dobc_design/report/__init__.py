"""A certificate as a page for people: HTML and Markdown.  Handed everything, computes nothing."""
