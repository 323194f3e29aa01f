"""Shared by tests: missions, archives and files of known content, and second implementations."""
