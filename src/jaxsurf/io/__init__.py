"""Height maps with spacing, units and source: reading and levelling them, without JAX."""
