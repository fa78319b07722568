"""How many cells a router carries, how many readers a cell, how many bytes a day, and what a lake costs."""
