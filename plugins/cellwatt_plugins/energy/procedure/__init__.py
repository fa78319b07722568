"""What a measurement by ECDP needs: pose of least gravity, programs of the cube, files cut from recordings."""
