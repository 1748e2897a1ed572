"""Library of materials: fabrics, prints and rubbers by name, with source, trust and range."""
