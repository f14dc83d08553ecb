"""The certificate: what was decided about a problem, and what a sceptic needs to decide it
again."""
