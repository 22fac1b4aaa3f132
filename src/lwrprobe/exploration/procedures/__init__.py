"""What is done with an arm and a sensor from start to end: explore, repeat, weigh, dry run, merge."""
