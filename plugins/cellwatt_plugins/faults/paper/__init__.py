"""The method of Sabry et al. as published: power patterns by vector fitting, fault tables, and their network."""
