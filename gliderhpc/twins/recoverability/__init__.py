"""Detectable disturbances, and the error of the unobserved part of the motion."""
