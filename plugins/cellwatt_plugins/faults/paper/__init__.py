"""The method of seed 002 as the paper has it: power patterns by vector fitting, fault tables, and their network."""
