"""``twin estimators``: filter, smoother and adjoint on the same twins, and which to use for what."""
