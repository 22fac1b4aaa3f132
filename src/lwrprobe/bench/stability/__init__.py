"""Forty stiff and extreme cases: what happened, and whether that is good enough."""

from lwrprobe.bench.stability.report import run

__all__ = ["run"]
