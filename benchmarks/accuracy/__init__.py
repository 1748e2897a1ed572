"""Shapes, forces and paths that are known from another source."""
