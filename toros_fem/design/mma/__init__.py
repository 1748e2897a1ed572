"""Svanberg's method of moving asymptotes, distributed over ranks."""
