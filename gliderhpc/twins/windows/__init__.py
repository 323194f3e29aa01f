"""Window length, margin, handover and transform of the adjoint."""
