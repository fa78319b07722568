"""Find where simulation and recordings differ, name the cause, model it, and show that the fit improves."""
