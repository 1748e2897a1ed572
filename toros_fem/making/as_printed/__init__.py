"""The print of a design, simulated again."""
