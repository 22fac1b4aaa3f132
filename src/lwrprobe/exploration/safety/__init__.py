"""Guards between strategy and arm, and the way back to safety."""
