"""What is done with an arm and a sensor from start to end: explore, repeat, calibrate, dry run, merge."""
