"""Law or model + key -> heights: Gaussian surfaces and growth models."""
