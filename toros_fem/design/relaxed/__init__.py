"""Relaxed designs: shares and directions of fine lines in each triangle as variables."""
