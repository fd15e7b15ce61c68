"""Measures 1-9 of the paper's Table III: heights -> Curve, batched and differentiable."""
