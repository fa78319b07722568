"""The live side: simulation of the frames, bands of the residuals, and the explanations that these start."""
