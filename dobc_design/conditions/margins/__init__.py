"""What a max-separable proof leaves room for: errors of weights and gains, and the inputs that it
needs."""
