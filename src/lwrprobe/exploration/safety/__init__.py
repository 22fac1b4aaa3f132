"""Guards between strategy and arm, and the retreat."""
