"""``twin windows``: window length, margin, handover and transform compared with the truth."""
