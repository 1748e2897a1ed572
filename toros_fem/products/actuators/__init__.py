"""Skins that move under pressure, designed from start to files."""
