"""Code that several drivers share; it depends on none of them."""
