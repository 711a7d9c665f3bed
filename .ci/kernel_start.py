"""Read by the kernels of notebooks under `.ci/run`: loops over lanes are compiled with all optimisations, whatever XLA_FLAGS says.

All other programs are compiled without, in half the time. Sweeps would run for five to eight times as long.
"""

from vijax._jax.compiler_options import FOR_LANES

FOR_LANES["xla_backend_optimization_level"] = 3
