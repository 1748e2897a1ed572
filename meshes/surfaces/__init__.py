"""Surfaces and targets from files; surfaces cut and laid flat as sewing patterns."""
