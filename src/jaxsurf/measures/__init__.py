"""Measures 1-9 of the paper's Table III: heights in, a `Curve` out.

Every public measure checks its arguments, flattens the batch and hands over to an array-level core
named in its module's docstring, which is plain JAX. Both work inside `jit`, `vmap` and `grad`.
"""
