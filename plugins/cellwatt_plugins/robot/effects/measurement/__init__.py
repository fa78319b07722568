"""What is measured: offsets, gains, drifts and delays."""
