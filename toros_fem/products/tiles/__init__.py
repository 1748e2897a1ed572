"""Periodic tiles: their stiffness, sheets of them, and pull tests (Fig. 7)."""
