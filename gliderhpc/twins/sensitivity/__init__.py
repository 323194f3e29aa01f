"""``twin sensitivity``: what noise, offsets, wrong coefficients, steps and gaps do to the answer."""
