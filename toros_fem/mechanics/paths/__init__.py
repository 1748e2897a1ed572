"""Paths of equilibria, through limit points too, and other states."""
