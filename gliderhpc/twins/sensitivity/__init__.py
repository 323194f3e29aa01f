"""``twin sensitivity``: effect of noise, offsets, wrong coefficients, steps and gaps on the estimates."""
