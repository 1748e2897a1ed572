"""Solves that must end in a stable equilibrium, or in an error that is true."""
