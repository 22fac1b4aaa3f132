"""The built-in exploration strategies, and the building blocks that any strategy may use.

- `grid`: the lines that cover an area
- `following`: one contour step along a surface at constant force, and rolling around a lost edge
- `states`: the state machine as one table
- `contouring`: the strategy that the built-in ones share; they differ in how they answer a collision threat
"""
