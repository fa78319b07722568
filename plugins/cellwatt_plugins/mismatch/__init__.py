"""Where simulation and recordings differ: find it, name it, model it, show the fit improve."""
