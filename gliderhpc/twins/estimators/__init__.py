"""Filter, smoothers and adjoint on the same records."""
