"""Energy, forces and tangent of a skin, summed over its terms."""
