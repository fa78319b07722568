"""What a measurement by ECDP needs: pose of least gravity, files cut from recordings."""
