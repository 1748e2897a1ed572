"""What every room stands on: errors, types, checks, settings, MPI, files."""
