"""Runs: the loop, its stages and guards, what is recorded, and the procedures built on it."""
