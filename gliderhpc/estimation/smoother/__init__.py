"""The iterated smoother of whole profiles: its maximum a posteriori problem, iteration and noise models."""
