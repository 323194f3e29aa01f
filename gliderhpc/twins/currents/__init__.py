"""Coverage of the current's ellipses, and vertical scales of the depth-resolved current."""
