"""A live cell for people: its state, assembled from its messages, and that state as lines of text."""
