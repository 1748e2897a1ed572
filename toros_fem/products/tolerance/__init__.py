"""As made, not as drawn: tolerances of print, materials and pressure (docs/tolerance.md)."""
