"""Stable equilibria of a skin by regularised Newton steps and continuation, eqs. (9, 10)."""
