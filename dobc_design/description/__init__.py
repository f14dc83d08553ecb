"""What a problem says, in words: what `dobc check` prints."""
