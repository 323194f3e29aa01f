"""Records of any source that a depth-averaged current needs: depth, pitch, heading and positions at the surface."""
