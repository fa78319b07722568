"""Play and elasticity between drive and link."""
