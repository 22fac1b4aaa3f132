"""The control loop: from wrench samples and arm states to set points."""
