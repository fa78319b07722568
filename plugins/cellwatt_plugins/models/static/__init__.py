"""Torque that an arm needs to hold still: poses to visit, their recognition, and models made from them."""
