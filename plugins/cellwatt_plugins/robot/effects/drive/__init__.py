"""Drives: rotors, limits, and what repeats with the motor's turn."""
