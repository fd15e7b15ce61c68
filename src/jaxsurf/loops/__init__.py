"""Measures 10-12 of the paper's Table III: contour loops, in NumPy alone."""
