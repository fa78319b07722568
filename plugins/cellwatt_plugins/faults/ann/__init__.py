"""A network that names faulty joints from the residual of power over a whole motion, and says where it cannot tell."""
