"""From design density to projected density: filters, projection, length scale, perimeter."""
