"""Terms that the data ask for: the regression problem of one side, its noise, and the search."""
