"""Options of XLA for programs of several kinds, and whether its release has them."""

import os
import re
from functools import cache

import jax

# Kernels of `in_one_kernel` can call no library and divide no work among threads: options for programs with sums of more
# than `UNROLLED` terms in kernels. `reshape-mover` and the algebraic simplifier undo each other until a limit of 25 rounds.
_PASSES = "xla_disable_hlo_passes"
# An option replaces what the environment says.
_DISABLED = re.findall(rf"--{_PASSES}=(\S+)", os.environ.get("XLA_FLAGS", ""))
FOR_SUMS = {
    "xla_cpu_experimental_ynn_fusion_type": "",
    _PASSES: ",".join(["cpu-parallel-task-assigner", "reshape-mover", *_DISABLED]),
}
# Options for programs that run once, or for milliseconds, and cost mostly their compilation. Without XLA's own code
# generator (before JAX 0.11) it takes half as long, and a fifth of the memory maps, of which a process has 65,530.
LIGHTLY = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_parallel_codegen_split_count": 4, **FOR_SUMS}
# Options for programs in which `in_parts` makes kernels: from JAX 0.12 on XLA would make one of the loop around them.
OF_PARTS = {**LIGHTLY, _PASSES: f"{FOR_SUMS[_PASSES]},small-while-loop-hoisting"}
OF_LARGE_PARTS = OF_PARTS | {"xla_backend_optimization_level": 1}
# Options for a loop over lanes.
FOR_LANES = OF_PARTS | {"xla_cpu_prefer_vector_width": 512}
FOR_LARGE_LANES = FOR_LANES | {"xla_backend_optimization_level": 1}
# Options for programs of thousands of operations that run some hundred times for a millisecond. LLVM's passes are most of
# the compilation, and such programs have few loops that gain by them.
QUICKLY = {"xla_backend_optimization_level": 0, **LIGHTLY}


@cache
def knows(name: str, value: bool | int | str) -> bool:
    """True where this version of XLA has an option of a CPU."""
    try:
        jax.jit(lambda: 0, compiler_options={name: value}).lower().compile()
    except Exception:  # which error is raised depends on the version
        return False
    return True
