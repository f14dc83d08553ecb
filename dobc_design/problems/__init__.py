"""The problem files shipped with the package; `dobc problems` lists them."""
