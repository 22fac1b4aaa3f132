"""Runs to look at: a live page in the browser (extra `view`) and films. Nothing else needs it."""
