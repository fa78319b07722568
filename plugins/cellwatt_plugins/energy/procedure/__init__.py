"""Tools for a measurement by ECDP: finds the pose of least gravity, cuts files from recordings."""
