"""Which motion would tell what the recordings cannot."""
