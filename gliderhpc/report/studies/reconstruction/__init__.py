"""Figures, tables and captions of study ``reconstruction``."""
