"""What the tables of tests are made of: pins and the meshes they stand on."""
