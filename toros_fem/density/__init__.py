"""From the design density to the printed one: filters, projection, width constraints, perimeter."""
