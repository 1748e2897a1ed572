"""Runs that survive: a folder with its lock, what is kept of its loops, and signals."""
