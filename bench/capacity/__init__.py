"""How many cells a router carries, how many readers a cell, and how many bytes a day."""
