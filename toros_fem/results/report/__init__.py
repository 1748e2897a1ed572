"""Reports of runs: one page that a browser opens offline, and animations (docs/report.md)."""
