"""Energy, forces and tangent of a skin, eqs. (1-10), with its supports and loads."""
