"""What people make: actuators, robots, tiles, and material constants from tests."""
