"""The guided measurement of ECDP: pose of least gravity, cube, readings at rest, runs cut from a recording."""
