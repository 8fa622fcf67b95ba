"""One thin script per table or figure; each runs as ``python -m experiments.NAME --help``."""
