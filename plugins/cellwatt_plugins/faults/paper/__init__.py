"""The method of Sabry et al. as the paper has it: power patterns by vector fitting, fault tables, and their network."""
