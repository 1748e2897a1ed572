"""Energy of a skin in UFL: no mesh, no solver, no version of dolfinx."""
