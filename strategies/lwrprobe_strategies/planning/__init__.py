"""What to do next: which lines, from where, how held. Nothing here moves the arm."""
