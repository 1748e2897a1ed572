"""From a target to a pattern: densities, lines, MMA and the loop, eqs. (11-19)."""
