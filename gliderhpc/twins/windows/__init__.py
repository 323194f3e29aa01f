"""``twin windows``: window, margin, handover and transform against the truth."""
