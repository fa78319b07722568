"""The live side: the simulation beside the frames, bands of its residuals, and the explanation that they call for."""
