"""lwrprobe: blind shape detection by touch.

The package is a house of rooms; importing it loads none of them. See docs/architecture.md.
"""

__version__ = "0.1.0"
