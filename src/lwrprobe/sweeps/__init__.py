"""Many explorations at once: on all cores, or on a cluster; their table and their page."""
