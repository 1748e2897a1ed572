"""Tiles designed towards a profile of stiffness (Fig. 7)."""
