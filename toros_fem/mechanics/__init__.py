"""The skin under load: energy, contact, equilibrium, paths, eqs. (1-10)."""
