"""Checks of records: faults, signs, spikes, gaps, and what a record is suitable for."""
