"""The way to a first settings file: questions, devices, and the file written from the answers."""
