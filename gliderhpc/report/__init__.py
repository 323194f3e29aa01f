"""Figures, tables against truth, and the demo: what people look at."""
