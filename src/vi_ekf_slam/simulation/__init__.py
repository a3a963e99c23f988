"""Simulated drives as datasets, and the picture of studies over many of them."""
