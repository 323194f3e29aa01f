"""Calibration on the steady glides of a mission: buoyancy, drag, trim and, where turns confirm them, lateral terms."""
