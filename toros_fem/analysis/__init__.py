"""Sequences of pressures, and the discretisation error of a result."""
