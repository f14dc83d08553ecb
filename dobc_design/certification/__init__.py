"""From a problem to a certificate: the order of the stages, cures, the overall verdict; and every
claim again."""
