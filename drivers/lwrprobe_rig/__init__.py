"""What the emulated devices have in common, and the rig that joins them to one simulated world."""
