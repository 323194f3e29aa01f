"""Tables and captions that the studies of turbulence share."""
