"""What is read off a shape, with its gradient: distances, angles, gaps, eqs. (17, 18)."""
