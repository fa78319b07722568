"""The guided measurement of seed 003: pose of least gravity, cube, readings at rest, runs cut from a recording."""
