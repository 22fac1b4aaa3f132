"""The cases, one module a room, each with a tuple `CASES`; a module put here is found by itself."""
