"""Explorations from Python: one call, one's own loop, and what a run found. Exported lazily by `lwrprobe`."""
