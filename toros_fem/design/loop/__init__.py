"""The design problem, its gradient and the loop that solves it, eqs. (11-19)."""
