"""The parts of scripts/benchmark.py.

`single` and `many` measure one trajectory and many, `sizes` larger machines, `first` the wait for a
first result, `accelerator` graphics cards (by scripts/accelerator.py too), `duffing` a nonlinear machine, `convergence` the solvers of diffrax, which `diffeqsolve` uses without vijax. `scenes` knows
what is right, `timing` measures, `peak` counts floating-point operations, `cpp` builds the C++ programs,
`report` writes and `pictures` draws.
"""

import jax

jax.config.update("jax_enable_x64", True)
# Figures are those of the processor, unless a part says otherwise.
jax.config.update("jax_default_device", jax.devices("cpu")[0])
