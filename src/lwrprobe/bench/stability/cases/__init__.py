"""The cases, one module a group, each with a tuple `CASES`; a module put here is found by itself."""
