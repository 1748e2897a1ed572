"""Stable equilibria by regularised Newton and continuation, eqs. (9, 10)."""
