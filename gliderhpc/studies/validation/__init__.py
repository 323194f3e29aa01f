"""The fixed-parameter forward model compared with the records (section 3)."""
