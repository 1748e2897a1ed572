"""Command lines of scripts and of `toros`: options, answers, exit codes, runs of scenes."""
