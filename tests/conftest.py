"""The suite runs as strictly as JAX can: no implicit rank or dtype promotion anywhere."""

import jax

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
