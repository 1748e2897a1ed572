"""Terms of a skin's energy: each states its law in UFL, or its energy, gradient and entries."""
