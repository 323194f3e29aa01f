"""Calibration on whole dives: rounds in which every dive is smoothed and its information on the hull is summed."""
