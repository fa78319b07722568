"""From files to runs: columns, tables, time grids, lining up, and what is refused."""
