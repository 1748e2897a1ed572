"""The skin's energy in UFL: no mesh, no solver, no version of dolfinx."""
