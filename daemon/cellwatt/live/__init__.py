"""A live cell for people: its state as messages tell it, and that state as lines of text."""
