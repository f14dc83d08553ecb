"""The observer gain W on request."""
