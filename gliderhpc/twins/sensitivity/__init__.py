"""Effects of noise, offsets, wrong coefficients, steps and gaps."""
