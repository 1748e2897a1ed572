"""Characterisation: material constants of eq. (1) from tensile tests."""
