"""What several drivers need, each thing once; knows no driver."""
