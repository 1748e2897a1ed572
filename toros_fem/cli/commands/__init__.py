"""The command line `toros`, one file for each command."""
