"""A skin's energy, force and tangent, eqs. (1-10): the forms meet the mesh here."""
