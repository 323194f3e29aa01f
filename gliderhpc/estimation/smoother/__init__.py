"""The iterated smoother of whole dives: its maximum a posteriori problem, iteration and noise models."""
