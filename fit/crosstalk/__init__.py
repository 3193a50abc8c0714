"""Cross-talk of the other degrees of freedom, unbiased by instrumental variables, and the Euler force."""
