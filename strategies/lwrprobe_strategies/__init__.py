"""The built-in exploration strategies, and the parts from which others are made.

- `skills`: compliant motions, one a file
- `planning`: what to do next, without motion: lines, paths, what the contacts so far leave out
- `supervisor`: runs a program of skills as a strategy; interruptions and trace
- `coverage`: the program over lines that the built-in strategies share; they differ in how they answer a collision
  threat, with a skill of `line_drive`
"""
