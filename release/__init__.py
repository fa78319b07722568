"""Builds what users install: sdist, wheel, Debian package, container image; each has a command that tries it."""
