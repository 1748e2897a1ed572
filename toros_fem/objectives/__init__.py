"""What is minimised and what is measured of a simulated shape, eqs. (17, 18)."""
