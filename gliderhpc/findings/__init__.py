"""Findings of a study: tables, figures and comparisons with the paper, and their files."""
