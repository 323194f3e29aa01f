"""Flight model for callers: it checks their arrays, calls the compiled kernels and returns arrays."""
