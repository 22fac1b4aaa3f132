"""What holds for all tests: hypothesis draws the same examples each time, and a loaded host is no failure."""

from hypothesis import settings

settings.register_profile("steady", derandomize=True, deadline=None)
settings.load_profile("steady")
