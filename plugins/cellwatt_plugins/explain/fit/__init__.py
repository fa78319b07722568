"""The terms that the data support: the regression problem of one side, its noise, and the search."""
